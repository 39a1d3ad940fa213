"""Where networks are trained."""

from __future__ import annotations

import torch


def usable_device(name: str) -> torch.device:
    """A device that can hold numbers and hand them back.

    Args:
        name: What was given as ``--device``.

    Raises:
        ValueError: It cannot, or there is no such device.
    """
    try:
        device = torch.device(name)
        torch.zeros(1, device=device).item()
    except (AssertionError, NotImplementedError, RuntimeError) as error:
        reason = str(error).partition("\n")[0]
        raise ValueError(f"--device {name!r} cannot be used: {reason}") from error
    return device
