"""Checkpoints that need no code of their author: a network as a ``torch.export`` archive.

The exported module is called as ``module(images, intrinsics, extrinsics, route_map,
measurements)``, with float32 tensors on the CPU:

* images: (1, 4, 3, H, W) RGB in [0, 1]: front, left, right, rear
* intrinsics: (1, 4, 3, 3), pixels
* extrinsics: (1, 4, 4, 4) ``camera_from_ego``, metres
* route_map: (1, 1, size, size) in [0, 1]
* measurements: (1, 3): speed in m/s, last acceleration and steering commands

It returns one tensor (1, C, size, size) and changes none of its buffers. The file
``bevtown.json`` inside the archive says what the tensor is: ``{"channels": [...], "output":
"probabilities"}``, where ``"output"`` may also be ``"logits"`` and may be left out.
:func:`save_source` writes such an archive; ``torch.export.save(program, path,
extra_files={"bevtown.json": ...})`` does too.
"""

from __future__ import annotations

import copy
import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bev_driving_env.files import write_bytes
from bev_driving_env.sources.checked import checked_channels, one_line
from bev_driving_env.sources.protocol import SensorFrame

if TYPE_CHECKING:
    import torch

METADATA = "bevtown.json"
OUTPUTS = ("probabilities", "logits")
INPUTS = ("images", "intrinsics", "extrinsics", "route_map", "measurements")


class ExportedSource:
    """A BEV source around a ``.pt2`` archive; it remembers nothing from frame to frame.

    An archive can contain pickled objects: load only those that you would also run.

    Attributes:
        path: The archive.
        channels: Names of the channels it predicts.
        camera_size: Height and width in pixels of the images it wants.
        bev_size: Side of the BEV in pixels.

    Args:
        path: The archive.

    Raises:
        FileNotFoundError: No such file.
        ImportError: torch is not installed.
        ValueError: Not such an archive; the message says what is wrong with it.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        owner = f"checkpoint {str(path)!r}"
        self.channels, self._output = _description(owner, _metadata(owner, self.path))
        torch = _torch()
        try:
            program = torch.export.load(self.path)
        except Exception as error:  # torch raises whatever its readers raise
            raise ValueError(f"{owner} cannot be loaded: {one_line(error)}") from error
        self._shapes = _input_shapes(owner, program)
        self.camera_size = self._shapes["images"][3:]
        self.bev_size = self._shapes["route_map"][3]
        self._module = program.module()
        _try_out(owner, self._module, self._shapes, len(self.channels))

    def reset(self) -> None:
        """Nothing is remembered."""

    def __call__(self, frame: SensorFrame) -> NDArray[np.float32]:
        """Predict the BEV of a frame.

        Returns:
            (C, size, size) float32 in [0, 1], if the network keeps to it.

        Raises:
            ValueError: The frame has not the sizes that the archive was exported for.
        """
        torch = _torch()
        inputs = _tensors(frame)
        for name, tensor in inputs.items():
            if tuple(tensor.shape) != self._shapes[name]:
                raise ValueError(
                    f"{self.path.name} was exported for {name} of shape {self._shapes[name]}, "
                    f"got {tuple(tensor.shape)}"
                )
        with torch.inference_mode():
            planes = self._module(*inputs.values())[0].float()
            if self._output == "logits":
                planes = planes.sigmoid()
            return planes.numpy()

    def predict_batch(self, frames: Sequence[SensorFrame]) -> NDArray[np.float32]:
        """Predict (N, C, size, size), frame by frame: the same bits as in single calls."""
        return np.stack([self(frame) for frame in frames])

    def __reduce__(self) -> tuple[type[ExportedSource], tuple[Path]]:
        # torch cannot pickle an exported module; the archive holds everything
        return type(self), (self.path.absolute(),)


def save_source(
    module: torch.nn.Module,
    path: str | Path,
    channels: Sequence[str],
    output: str = "probabilities",
    camera_size: tuple[int, int] = (112, 240),
    bev_size: int = 192,
) -> None:
    """Export a network and write it as an archive that :class:`ExportedSource` reads.

    A copy of the module is exported, in evaluation mode, on the CPU and in float32; the module
    itself is left as it is. Only a complete archive appears under the name.

    Args:
        module: Called with the tensors that this file's first lines list.
        path: Where to write, ending in ``.pt2``.
        channels: Names of the channels it predicts, C of them, of ``frames.CHANNELS``.
        output: ``"probabilities"``, or ``"logits"`` if a sigmoid is still to come.
        camera_size: Height and width in pixels of the images it wants.
        bev_size: Side of the BEV in pixels.

    Raises:
        ImportError: torch is not installed.
        ValueError: Wrong suffix, channels or output, a module that cannot be exported, or one
            that returns something else or changes its buffers.
    """
    torch = _torch()
    path = Path(path)
    if path.suffix != ".pt2":
        raise ValueError(f"path must end in .pt2, got {str(path)!r}")
    description = {"channels": list(channels), "output": output}
    _description("save_source", description)
    shapes = _shapes(camera_size, bev_size)
    try:
        frozen = copy.deepcopy(module).to("cpu", torch.float32).eval()
        program = torch.export.export(frozen, _example(shapes))
    except Exception as error:  # tracing runs foreign code
        raise ValueError(f"the module cannot be exported: {one_line(error)}") from error
    planes = _try_out("the module", program.module(), shapes, len(channels))
    if output == "probabilities" and not (planes.min() >= 0.0 and planes.max() <= 1.0):
        raise ValueError(
            f"the module must return probabilities in [0, 1], got values from {planes.min():g} to "
            f'{planes.max():g}; if a sigmoid is still to come, output="logits"'
        )
    archive = io.BytesIO()
    torch.export.save(program, archive, extra_files={METADATA: json.dumps(description)})
    write_bytes(path, archive.getvalue())


def _torch() -> ModuleType:
    try:
        import torch
    except ImportError as error:
        raise ImportError("a .pt2 checkpoint needs torch: pip install torch") from error
    return torch


def _metadata(owner: str, path: Path) -> Any:
    """What ``bevtown.json`` holds; read without torch, whose reader complains at length."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = [name for name in archive.namelist() if name.endswith(f"/{METADATA}")]
            if not names:
                raise ValueError(
                    f"{owner} has no {METADATA}; write it with perception.exported.save_source"
                )
            return json.loads(archive.read(names[0]))
    except zipfile.BadZipFile as error:
        raise ValueError(f"{owner} is no torch.export archive: {one_line(error)}") from error
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{owner} has a {METADATA} that is no JSON: {one_line(error)}") from error


def _description(owner: str, value: Any) -> tuple[tuple[str, ...], str]:
    """Channels and kind of output from the content of ``bevtown.json``."""
    if not isinstance(value, Mapping):
        raise ValueError(f"{owner}: {METADATA} must be an object with channels, got {value!r}")
    output = value.get("output", OUTPUTS[0])
    if output not in OUTPUTS:
        raise ValueError(f"{owner}: output must be {' or '.join(OUTPUTS)}, got {output!r}")
    return checked_channels(owner, value.get("channels")), output


def _shapes(camera_size: tuple[int, int], bev_size: int) -> dict[str, tuple[int, ...]]:
    """Shapes of the five inputs."""
    height, width = camera_size
    shapes = ((4, 3, height, width), (4, 3, 3), (4, 4, 4), (1, bev_size, bev_size), (3,))
    return {name: (1, *shape) for name, shape in zip(INPUTS, shapes, strict=True)}


def _input_shapes(owner: str, program: torch.export.ExportedProgram) -> dict[str, tuple[int, ...]]:
    """Shapes of the inputs that a program was exported for."""
    wanted = program.graph_signature.user_inputs
    nodes = {node.name: node for node in program.graph.nodes if node.op == "placeholder"}
    came = [tuple(getattr(nodes[str(name)].meta.get("val"), "shape", ())) for name in wanted]
    fixed = all(isinstance(side, int) for shape in came for side in shape)  # symbolic ones are not
    try:
        shapes = _shapes((came[0][3], came[0][4]), came[3][3])
    except IndexError:
        shapes = {}
    if not fixed or came != list(shapes.values()):
        raise ValueError(
            f"{owner} must take {', '.join(INPUTS)} of fixed shapes (1, 4, 3, H, W), (1, 4, 3, 3), "
            f"(1, 4, 4, 4), (1, 1, size, size), (1, 3); it takes "
            f"{', '.join(str(shape) for shape in came) or 'nothing'}"
        )
    return shapes


def _example(shapes: Mapping[str, tuple[int, ...]]) -> tuple[torch.Tensor, ...]:
    """Inputs to trace with and to try out: black images of unrotated cameras."""
    torch = _torch()
    inputs = {name: torch.zeros(shape) for name, shape in shapes.items()}
    for name in ("intrinsics", "extrinsics"):
        inputs[name] += torch.eye(shapes[name][-1])
    return tuple(inputs.values())


def _try_out(
    owner: str, module: torch.nn.Module, shapes: Mapping[str, tuple[int, ...]], channels: int
) -> torch.Tensor:
    """Run a module once: it must return one tensor of the right shape and remember nothing."""
    torch = _torch()
    before = {name: buffer.clone() for name, buffer in module.named_buffers()}
    try:
        with torch.inference_mode():
            planes = module(*_example(shapes))
    except Exception as error:
        raise ValueError(f"{owner} cannot be run: {one_line(error)}") from error
    came = tuple(planes.shape) if isinstance(planes, torch.Tensor) else type(planes).__name__
    expected = (1, channels, *shapes["route_map"][2:])
    if came != expected:
        raise ValueError(f"{owner} must return one tensor of shape {expected}, got {came}")
    changed = [
        name for name, buffer in module.named_buffers() if not torch.equal(before[name], buffer)
    ]
    if changed:
        raise ValueError(
            f"{owner} must not remember anything, but changes its buffers {', '.join(changed)}"
        )
    return planes


def _tensors(frame: SensorFrame) -> dict[str, torch.Tensor]:
    """The inputs of the network, from a frame; none shares memory with it."""
    torch = _torch()
    images = np.divide(np.moveaxis(frame.images, -1, -3), 255.0, dtype=np.float32, order="C")
    route_map = np.divide(frame.route_map, 255.0, dtype=np.float32)
    return {
        "images": torch.from_numpy(images)[None],
        "intrinsics": torch.tensor(frame.intrinsics, dtype=torch.float32)[None],
        "extrinsics": torch.tensor(frame.extrinsics, dtype=torch.float32)[None],
        "route_map": torch.from_numpy(route_map)[None, None],
        "measurements": torch.tensor(frame.measurements, dtype=torch.float32)[None],
    }
