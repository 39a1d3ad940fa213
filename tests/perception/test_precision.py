"""Where bfloat16 is used."""

import pytest
import torch

from perception.precision import bf16_pays_off, resolved_precision


@pytest.mark.parametrize("amx", [True, False])
def test_auto_is_bf16_on_processors_with_amx_alone(amx, monkeypatch):
    monkeypatch.setattr(torch.cpu, "_is_amx_tile_supported", lambda: amx)
    monkeypatch.setattr(torch.cpu, "_is_avx512_bf16_supported", lambda: True, raising=False)
    assert bf16_pays_off() == amx
    assert resolved_precision("auto") == ("bf16" if amx else "fp32")
    assert [resolved_precision(name) for name in ("fp32", "bf16")] == ["fp32", "bf16"]


def test_a_torch_that_cannot_tell_computes_in_single_precision(monkeypatch):
    monkeypatch.delattr(torch.cpu, "_is_amx_tile_supported", raising=False)
    assert resolved_precision("auto") == "fp32"


@pytest.mark.parametrize("has_it", [True, False])
def test_auto_is_bf16_on_gpus_that_have_it(has_it, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_bf16_supported", lambda including_emulation: has_it)
    assert resolved_precision("auto", torch.device("cuda")) == ("bf16" if has_it else "fp32")


def test_another_precision_is_refused():
    with pytest.raises(ValueError, match="one of auto, fp32, bf16, got 'fp8'"):
        resolved_precision("fp8")
