"""CLIP's towers: which there are, where their weights come from, how they are read. Costs no torch until `load`.

Weights are `.safetensors`: a table of names, shapes and numbers, and nothing that runs. They have open_clip's names,
which are OpenAI's; half precision and the three numbers that OpenAI keeps beside the weights are taken as well.

Not taken are pickles, as `.pt` and `.bin` files are, and OpenAI's own TorchScript archives (`RN50.pt`): one that is
loaded runs the code that it carries, and that code can write files (an archive whose `__setstate__` calls
`torch.from_file(path, shared=True, ...)` made the file when `torch.jit.load` read it, torch 2.15). Who trusts such a
file converts it once; the sentence that refuses it says how.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from equigrasp.artefacts import check_readable
from equigrasp.errors import InputError, unknown
from equigrasp.hub import is_online
from equigrasp.late import late

if TYPE_CHECKING:
    from open_clip import CLIP
    from open_clip.tokenizer import SimpleTokenizer

OPENAI, RANDOM = "openai", "random"
"""What weights can be besides a file: OpenAI's, from the Hugging Face cache or the network; none, fresh numbers."""

HUB_FILE = "open_clip_model.safetensors"

BESIDE_THE_WEIGHTS = {"input_resolution", "context_length", "vocab_size"}
"""Numbers in OpenAI's own files that are no weights."""


ELSEWHERE = ("timm", "timm.layers", "torch._dynamo", "torch._dynamo.utils")
"""Three quarters of open_clip's start, for towers that are none of these and for torchvision's compiled regions."""


@dataclass(frozen=True)
class Tower:
    """One CLIP.

    Attributes:
        architecture: open_clip's name for it; OpenAI's weights want QuickGELU.
        repository: where OpenAI's weights are on the Hugging Face hub.
        size: D, the width of its embeddings.
        first: shape of `visual.conv1.weight`.
        last: shape of `text_projection`; with `first` it tells the towers apart.
    """

    architecture: str
    repository: str
    size: int
    first: tuple[int, ...]
    last: tuple[int, ...]


def _resnet(depth: int, size: int) -> Tower:
    return Tower(f"RN{depth}-quickgelu", f"timm/resnet{depth}_clip.openai", size, (32, 3, 3, 3), (512, size))


def _transformer(name: str, words: str, patch: int, width: int, size: int) -> Tower:
    repository = f"timm/vit_{words}_patch{patch}_clip_224.openai"
    return Tower(f"ViT-{name}-{patch}-quickgelu", repository, size, (width, 3, patch, patch), (size, size))


TOWERS: dict[str, Tower] = {
    "clip-rn50": _resnet(50, 1024),
    "clip-rn101": _resnet(101, 512),
    "clip-vit-b-32": _transformer("B", "base", 32, 768, 512),
    "clip-vit-b-16": _transformer("B", "base", 16, 768, 512),
    "clip-vit-l-14": _transformer("L", "large", 14, 1024, 768),
}


def find(name: str) -> Tower:
    """The tower of that name.

    Raises:
        InputError: if there is none; it names the nearest.
    """
    if name not in TOWERS:
        raise unknown("CLIP", name, TOWERS)
    return TOWERS[name]


def find_weights(name: str, weights: str) -> Path:
    """The file of a tower's weights, looked at as far as its table of contents.

    Args:
        name: of the tower.
        weights: "openai", or a file.

    Raises:
        InputError: within two seconds, if they are not to be had, or the file is damaged or another tower's.
    """
    path = _openai(name) if weights == OPENAI else find_file(name, weights)
    check_file(name, path)
    return path


def find_file(name: str, file: str) -> Path:
    """The path of a tower's local file; InputError if there is none."""
    path = Path(file).expanduser()
    if not path.is_file():
        raise InputError(f"the weights of {name} are a .safetensors file, but {file!r} is not one on this machine")
    return path


def check_file(name: str, path: Path) -> None:
    """Raise an InputError unless this is a whole `.safetensors` file with that tower's weights; reads its header."""
    from safetensors import SafetensorError, safe_open

    tower = find(name)
    if path.suffix != ".safetensors":
        raise InputError(
            f"{path} is no .safetensors file, and others can run code when they are read; if you trust it, convert it "
            'once: python -c "import sys, torch, safetensors.torch as s; s.save_file({k: v.contiguous() for k, v in '
            f"torch.jit.load(sys.argv[1], 'cpu').state_dict().items()}}, sys.argv[2])\" {path.name} "
            f"{path.with_suffix('.safetensors').name}"
        )
    check_readable(path)
    try:
        with safe_open(path, framework="np") as file:
            names = set(file.keys())
            found = tuple(
                tuple(file.get_slice(key).get_shape()) if key in names else None
                for key in ("visual.conv1.weight", "text_projection")
            )
    except (SafetensorError, OSError) as error:
        raise InputError(f"{path} is damaged, or no .safetensors file at all ({error}); fetch it again") from None
    if found != (tower.first, tower.last):
        whose = [other for other, each in TOWERS.items() if found == (each.first, each.last)]
        raise InputError(
            f"{path} does not hold the weights of {name}"
            + (f", but those of {whose[0]}; name that one, or another file" if whose else "; name a file that does")
        )


def load(name: str, weights: str) -> CLIP:
    """Both towers with their weights, float32, in eval mode.

    Args:
        name: of the tower.
        weights: "openai", a file, or "random", which draws from torch's generator.

    Raises:
        InputError: as `find_weights`; or if tensors are missing from the file.
    """
    tower = find(name)
    path = None if weights == RANDOM else find_weights(name, weights)

    import torch
    from safetensors.torch import load_file

    with late(*ELSEWHERE):
        from open_clip import CLIP, get_model_config

    config = get_model_config(tower.architecture)
    assert config is not None
    if path is None:
        return CLIP(**config).eval()
    with torch.random.fork_rng(devices=[]):
        model = CLIP(**config)
    tensors = {key: value.float() for key, value in load_file(path).items() if key not in BESIDE_THE_WEIGHTS}
    try:
        model.load_state_dict(tensors, strict=True)
    except RuntimeError as error:
        reason = " ".join(line.strip() for line in str(error).splitlines()[1:])[:200]
        raise InputError(f"{path} does not hold the weights of {name}: {reason}") from None
    return model.eval()


def tokenizer(name: str) -> SimpleTokenizer:
    """What makes a tower's tokens of a sentence, from open_clip's own files."""
    with late(*ELSEWHERE):
        from open_clip import SimpleTokenizer, get_tokenizer

    made = get_tokenizer(find(name).architecture)
    assert isinstance(made, SimpleTokenizer)
    return made


def _openai(name: str) -> Path:
    """OpenAI's weights as a local file, fetched if need be.

    Raises:
        InputError: within two seconds, if they are not in the cache and there is no network.
    """
    import huggingface_hub

    repository = find(name).repository
    cached = huggingface_hub.try_to_load_from_cache(repository, HUB_FILE)
    if isinstance(cached, str):
        return Path(cached)
    problem = "there is no network"
    if is_online():
        try:
            return Path(huggingface_hub.hf_hub_download(repository, HUB_FILE))
        except OSError as error:
            problem = f"fetching them failed ({type(error).__name__})"
    raise InputError(
        f"the weights of {name} are not on this machine and {problem}: name a local file of them "
        f"('{name}:/path/to/{HUB_FILE}' as a text encoder, --clip-weights for a model), fill the Hugging Face cache "
        f"with {repository} while there is a network, or do without: use the text encoder 'minilm' or 'hashing', and "
        "--clip-weights random"
    )
