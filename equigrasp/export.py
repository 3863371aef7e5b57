"""A policy as one file that needs neither equigrasp nor escnn: a program of torch.export (`.pt2`), or ONNX.

The program takes `observation`, `(1, 4, H, W)` float32 as `policy.to_tensor` makes it, and `embedding`, `(1, D)` of
the instruction, and gives `log_probabilities`, `(1, 36, H / stride, W / stride)` float32, whose largest is the grasp.
It computes in float32 whatever the policy's own precision. ONNX has no FFT of this kind: there, the correlation is the
convolution that it equals, which takes longer. Files are only written here: reading a `.pt2` may unpickle.
"""

from __future__ import annotations

import copy
import importlib.util
import io
import json
import tempfile
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import torch
from torch import Tensor, nn

from equigrasp.artefacts import remove_partials_of, write_atomically
from equigrasp.errors import InputError, unknown
from equigrasp.grasp import Observation
from equigrasp.policy import GraspPolicy, LegPolicy, evaluating, to_tensor
from equigrasp.reference_head import correlate_directly
from equigrasp.sharing.shareable import portable_encoder
from equigrasp.workspace import WORKSPACE

if TYPE_CHECKING:
    from torch.export import ExportedProgram

INPUTS = ("observation", "embedding")
OUTPUT = "log_probabilities"
METADATA = "equigrasp.json"
STACK_TRACE = "pkg.torch.onnx.stack_trace"
"""Of a node of an `.onnx`: where torch made it, numbered anew at each export; left out, so that a file is the same."""
SCENES = 3
"""Scenes of noise on which the file is compared with the policy."""

Program = Callable[[Tensor, Tensor], Tensor]


@dataclass(frozen=True)
class Agreement:
    """How far a file's log-probabilities are from the policy's own, both in float32, in the worst of several scenes.

    Attributes:
        largest: the largest difference of any cell and bin; infinite where one alone forbids a grasp.
        spread: between the policy's largest and its smallest that is finite, what a difference is to be held against.
    """

    largest: float
    spread: float


class LogProbabilities(nn.Module):
    """What is exported: `GraspPolicy.log_probabilities` as a forward pass."""

    def __init__(self, policy: GraspPolicy) -> None:
        super().__init__()
        self.policy = policy

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        """`(1, 4, H, W)`, `(1, D)` -> `(1, 36, H / stride, W / stride)`."""
        return self.policy.log_probabilities(observation, embedding)


@torch.no_grad()
def export(
    policy: GraspPolicy,
    out: Path,
    shape: tuple[int, int] = WORKSPACE.shape,
    seen: Sequence[tuple[Observation, str]] = (),
) -> Agreement:
    """Write a policy as a program, and compare it with the policy before it is written.

    Args:
        policy: stays as it is; its weights are float32 and lie on the CPU.
        out: a file named .pt2 or .onnx, which is replaced.
        shape: (H, W) of the heightmaps.
        seen: observations `(H, W)` and instructions to compare the two on, beside `SCENES` scenes of noise. Of noise a
            trained policy says little, and differences are as small.

    Raises:
        InputError: if the name says no format, ONNX is not installed, or the model has a part that cannot be exported,
            lies on a GPU, or is not of float32; an observation has another size; or if of a scene no grasp is the best,
            by the policy or the program.
    """
    for observation, _ in seen:
        if observation.shape != shape:
            raise InputError(f"{observation} is to be compared on, but the file takes heightmaps of {shape} pixels")
    write = writer(out)
    check_place(policy)
    with evaluating(policy):
        # a shallow copy: the same modules, and settings of its own
        plain = copy.copy(policy)
        plain.precision = "float32"
        scenes = [noise(policy.embedding_size, shape, seed) for seed in range(SCENES)]
        scenes += [(to_tensor(observation)[None], policy.embed(sentence)[None]) for observation, sentence in seen]
        # before the export: what is made once for a size must be numbers by then, not symbols
        expected = [plain.log_probabilities(*scene) for scene in scenes]
        for each in expected:
            check_best(f"{type(policy).__name__} gives", each)
        content, program = write(plain, scenes[0], metadata(policy, shape))
        found = [program(*scene) for scene in scenes]
    agreed = [agreement(one, other) for one, other in zip(found, expected, strict=True)]
    out.parent.mkdir(parents=True, exist_ok=True)
    remove_partials_of(out)
    write_atomically(out, content)
    return Agreement(max(each.largest for each in agreed), max(each.spread for each in agreed))


def check_best(who: str, log_probabilities: Tensor) -> None:
    """Raise an InputError unless a cell and a bin are the best: none is NaN, not all are minus infinity."""
    if not log_probabilities.max().isfinite():
        raise InputError(
            f"{who} log-probabilities of which none is the best, NaN or all minus infinity, on a scene to be compared "
            "on; nothing was written; are its weights NaN?"
        )


def agreement(found: Tensor, expected: Tensor) -> Agreement:
    """How far a program's log-probabilities of one scene are from the policy's, which has a best grasp.

    Where both forbid a grasp, minus infinity, they agree; where one alone does, they are infinitely far apart.

    Raises:
        InputError: if by the program no grasp is the best.
    """
    check_best("the program made of the policy gives", found)
    apart = torch.where(found == expected, 0.0, found - expected)
    finite = expected[expected.isfinite()]
    return Agreement(float(apart.abs().max()), float(finite.max() - finite.min()))


def check_place(policy: GraspPolicy) -> None:
    """Raise an InputError unless all weights are where programs compute, float32 on the CPU."""
    for name, weight in policy.named_parameters():
        if weight.device.type != "cpu" or weight.dtype != torch.float32:
            raise InputError(
                f"a program is made of float32 weights on the CPU, but {name} is {weight.dtype} on {weight.device}; "
                "export a copy, copy.deepcopy(policy).float().cpu()"
            )


def writer(out: Path) -> Callable[[GraspPolicy, tuple[Tensor, Tensor], dict[str, str]], tuple[bytes, Program]]:
    """What makes the format that a file's name says.

    Raises:
        InputError: if it says none, what ONNX needs is not installed, or there is no temporary folder, which both
            formats need.
    """
    formats = {".pt2": torch_program, ".onnx": onnx_program}
    if out.suffix not in formats:
        raise unknown("format of an exported policy", out.suffix or out.name, formats)
    if out.suffix == ".onnx":
        for package in ("onnx", "onnxscript", "onnxruntime"):
            if importlib.util.find_spec(package) is None:
                raise InputError(
                    f"{out.name} needs {package}, which is not here; `pip install -e '.[onnx]'` in equigrasp's folder"
                )
    try:
        tempfile.gettempdir()
    except FileNotFoundError:
        raise InputError("no temporary folder can be written; set TMPDIR to a folder of yours") from None
    return formats[out.suffix]


def torch_program(policy: GraspPolicy, scene: tuple[Tensor, Tensor], metadata: dict[str, str]) -> tuple[bytes, Program]:
    """A `.pt2`: the bytes of the file, and the program itself."""
    program = traced(policy, scene)
    file = io.BytesIO()
    with warnings.catch_warnings():
        # it takes weights in channels last for parts of something larger, and then stores them whole all the same
        warnings.filterwarnings("ignore", "No complete tensor found")
        torch.export.save(program, file, extra_files={METADATA: json.dumps(metadata, sort_keys=True)})
    return file.getvalue(), cast(Program, program.module())


def onnx_program(policy: GraspPolicy, scene: tuple[Tensor, Tensor], metadata: dict[str, str]) -> tuple[bytes, Program]:
    """An `.onnx`: the bytes of the file, and the program that ONNX Runtime reads from them."""
    import onnxruntime

    if isinstance(policy, LegPolicy):
        policy.correlation = correlate_directly
    names: dict[str, Any] = {"input_names": list(INPUTS), "output_names": [OUTPUT]}
    made = torch.onnx.export(traced(policy, scene), (), dynamo=True, verbose=False, **names)
    assert made is not None
    model = made.model_proto
    for key, value in metadata.items():
        model.metadata_props.add(key=key, value=value)
    for node in (*model.graph.node, *(each for function in model.functions for each in function.node)):
        kept = [each for each in node.metadata_props if each.key != STACK_TRACE]
        del node.metadata_props[:]
        node.metadata_props.extend(kept)
    content = model.SerializeToString()
    session = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])

    def run(observation: Tensor, embedding: Tensor) -> Tensor:
        (result,) = session.run([OUTPUT], dict(zip(INPUTS, (observation.numpy(), embedding.numpy()), strict=True)))
        return torch.from_numpy(result)

    return content, run


def traced(policy: GraspPolicy, scene: tuple[Tensor, Tensor]) -> ExportedProgram:
    """The policy's operations on tensors, one after the other; where their code lies is nobody's business.

    Raises:
        InputError: if torch cannot follow them.
    """
    try:
        program = torch.export.export(LogProbabilities(policy).eval(), scene)
    except Exception as error:  # whatever a model's own code raises when its tensors are symbols
        name = getattr(policy.config, "name", type(policy).__name__)
        why = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise InputError(f"{name} cannot be exported, because torch.export cannot follow it: {why:.300}") from error
    for module in program.graph_module.modules():
        if isinstance(module, torch.fx.GraphModule):
            for node in module.graph.nodes:
                node.meta.pop("stack_trace", None)
    return program


def metadata(policy: GraspPolicy, shape: tuple[int, int]) -> dict[str, str]:
    """What must be known to use the file: who embeds the instruction, and how cells and bins become a grasp.

    Of an encoder's local file the name alone: where it lies on this machine is nobody's business.
    """
    return {
        "model": getattr(policy.config, "name", type(policy).__name__),
        "text_encoder": portable_encoder(policy.text_encoder),
        "height_width": f"{shape[0]} {shape[1]}",
        "stride": str(policy.stride),
        "bins": str(policy.bins),
        "equigrasp": version("equigrasp"),
    }


def noise(embedding_size: int, shape: tuple[int, int], seed: int) -> tuple[Tensor, Tensor]:
    """A scene and an embedding without meaning, in the range of real ones: `(1, 4, H, W)`, `(1, D)`."""
    generator = torch.Generator().manual_seed(seed)
    scale = torch.tensor([255.0, 255.0, 255.0, 0.1]).view(4, 1, 1)
    observation = torch.rand(1, 4, *shape, generator=generator) * scale
    embedding = torch.randn(1, embedding_size, generator=generator)
    return observation, torch.nn.functional.normalize(embedding)
