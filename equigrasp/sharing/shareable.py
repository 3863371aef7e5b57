"""Policies saved and shared as the Hugging Face hub's models are: a folder of config.json, model.safetensors, a card.

`GraspPolicy` is `Shareable`. Its config.json is a run folder's, as far as it is known: `model` is the `ModelConfig`
that the policy is built from, and what a training recorded stands beside it. So a run folder is read as a saved
policy is, and a saved policy of a run is evaluated as the run. The weights are all of them, frozen ones too: a model
on CLIP asks for no CLIP when it is loaded. Nothing is ever unpickled.
"""

from __future__ import annotations

import functools
import shlex
import sys
from collections.abc import Mapping
from dataclasses import is_dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from huggingface_hub import ModelCard, PyTorchModelHubMixin
from safetensors import SafetensorError
from safetensors.torch import load as load_tensors
from safetensors.torch import save as save_tensors
from torch import Tensor, nn
from typing_extensions import Self

from equigrasp import hub
from equigrasp.artefacts import read_json, write_atomically, write_json
from equigrasp.config import ClipConfig, ModelConfig
from equigrasp.errors import InputError
from equigrasp.models import build, check_kept
from equigrasp.plan import PLAN, WEIGHTS, check_weights, damaged, read_model, stamp
from equigrasp.sharing.model_card import CARD, LICENSE, is_card, model_card

if TYPE_CHECKING:
    from equigrasp.policy import GraspPolicy

PICKLES = (".bin", ".pt", ".pth", ".ckpt", ".pkl")


class Shareable(
    PyTorchModelHubMixin,
    library_name="equigrasp",
    license=LICENSE,
    pipeline_tag="robotics",
    tags=["grasping", "equivariance", "language-conditioned"],
):
    """What a policy gets from being one of the hub's models.

    Attributes:
        config: what the policy was built from; `equigrasp.models.build` and loading set it.
        record: what its config.json says besides: the training, the task, the demonstrations. Empty if never trained.
    """

    config: ModelConfig | None = None
    record: Mapping[str, Any] = MappingProxyType({})

    def save_pretrained(self, save_directory: str | Path, **options: Any) -> str | None:
        """Save the policy as a folder, over one that is there; a README.md that equigrasp did not write stays.

        Args:
            save_directory: the folder; made if it is not there.
            options: of `PyTorchModelHubMixin.save_pretrained`: model_card_kwargs, push_to_hub, and so on.

        Returns:
            The commit's address, with push_to_hub.

        Raises:
            InputError: before anything is written, if no file could say how the policy is built.
        """
        self._check_kept()
        return super().save_pretrained(save_directory, **options)

    def _check_kept(self) -> ModelConfig:
        """The config; InputError if there is none, or a file would not lead back to it."""
        if self.config is None:
            raise InputError(
                f"this {type(self).__name__} was put together by hand, and a file cannot say how; make it by "
                "`equigrasp.models.build` of a config (docs/my_policy.md shows one of your own), then save it"
            )
        check_kept(self.config)
        return self.config

    def _save_pretrained(self, save_directory: Path) -> None:
        assert isinstance(self, nn.Module)
        config = self._check_kept()
        weights = packed(self.state_dict(), stamp(config))
        # the mixin writes a card where there is none
        if is_stale(save_directory, config, weights):
            (save_directory / CARD).unlink()
        write_json(save_directory / PLAN, {**self.record, "model": config.to_dict()})
        write_atomically(save_directory / WEIGHTS, weights)

    @classmethod
    def from_pretrained(  # ty: ignore[incompatible-method-override]
        cls,
        pretrained_model_name_or_path: str | Path,
        *,
        force_download: bool = False,
        token: str | bool | None = None,
        cache_dir: str | Path | None = None,
        local_files_only: bool = False,
        revision: str | None = None,
        text_encoder: str | None = None,
    ) -> Self:
        """Load a policy, ready to act.

        Args:
            pretrained_model_name_or_path: a folder (of `save_pretrained`, or a run's), or a model's id on the hub.
            force_download: fetch again what is in the cache.
            token: for private models; None for the one that `hf auth login` kept.
            cache_dir: where fetched files are kept.
            local_files_only: do not ask the network.
            revision: a branch, tag or commit on the hub.
            text_encoder: the policy's own text encoder with its weights in another place,
                "clip-rn50:/path/to/weights.safetensors"; another encoder is refused.

        Raises:
            InputError: if there is no such policy, it is damaged, its weights are a pickle or another model's, or it
                is no `cls`; within two seconds, if it is not on this machine and there is no network.
        """
        folder = Path(pretrained_model_name_or_path)
        if not folder.is_dir():
            name = str(pretrained_model_name_or_path)
            fetch = functools.partial(
                hub.fetch,
                name,
                revision=revision,
                cache_dir=cache_dir,
                force_download=force_download,
                local_files_only=local_files_only,
                token=token,
            )
            folder = fetch((PLAN,))
            check_is_known(name, read_json(folder / PLAN, "a policy's configuration"))
            folder = fetch((WEIGHTS,))
        policy = load(folder, text_encoder)
        if not isinstance(policy, cls):
            raise InputError(
                f"{pretrained_model_name_or_path} holds a {type(policy).__name__}, not a {cls.__name__}; "
                "load it with GraspPolicy.from_pretrained"
            )
        return policy

    def push_to_hub(self, repo_id: str, **options: Any) -> str:
        """Save the policy and upload the folder as one commit; the paths of local files stay here.

        Args:
            repo_id: the model's id on the hub, "user/name"; made if it is not there.
            options: of `PyTorchModelHubMixin.push_to_hub`: private, token, branch, commit_message, and so on.

        Returns:
            The commit's address.

        Raises:
            InputError: within two seconds, if there is no network; or if no file could say how the policy is built,
                or the hub refuses.
        """
        self._check_kept()
        hub.check_can_push(repo_id)
        own = self.config
        self.config = None if own is None else portable(own)
        try:
            return super().push_to_hub(repo_id, **options)
        except OSError as error:
            raise InputError(
                f"the hub did not take {repo_id} ({type(error).__name__}); log in with `hf auth login`, with a token "
                "that may write there"
            ) from None
        finally:
            self.config = own

    def generate_model_card(self, *args: Any, **kwargs: Any) -> ModelCard:
        """The card (`equigrasp.sharing.model_card`), of what is recorded and the measurements in `kwargs`."""
        assert is_dataclass(self.config)
        return ModelCard(model_card(self.config, self.record, self._hub_mixin_info.model_card_data, **kwargs))


def is_stale(folder: Path, config: ModelConfig, weights: bytes) -> bool:
    """Whether the folder's README.md is equigrasp's own card, but of another model or of other weights.

    Args:
        folder: that is about to be saved into.
        config: what the policy is built from.
        weights: what model.safetensors will be.
    """
    try:
        text = (folder / CARD).read_text()
    except (OSError, UnicodeDecodeError):
        return False
    if not is_card(text):
        return False
    old = folder / WEIGHTS
    return f"\n# {config.name}\n" not in text or not old.exists() or old.read_bytes() != weights


def packed(tensors: Mapping[str, Tensor], metadata: dict[str, str] | None = None) -> bytes:
    """Tensors, and what is said of them, as the bytes of a `.safetensors` file; one of two names is there twice."""
    memory: set[int] = set()
    own: dict[str, Tensor] = {}
    for name, value in tensors.items():
        value = value.detach().cpu().contiguous()
        place = value.untyped_storage().data_ptr()
        # the format has no two names for one memory
        own[name] = value.clone() if place in memory else value
        memory.add(place)
    return save_tensors(own, metadata)


def load(folder: Path, text_encoder: str | None = None) -> GraspPolicy:
    """The policy of a folder, ready to act; see `Shareable.from_pretrained`."""
    if not (folder / PLAN).exists():
        out = shlex.quote(str(folder))
        raise InputError(f"{folder} holds no saved policy (no {PLAN}); make one with `equigrasp share --out {out}`")
    configuration = read_json(folder / PLAN, "a policy's configuration")
    model = read_model(configuration, folder / PLAN)
    if text_encoder is not None:
        model = read_by(model, text_encoder)
    policy = restore(model, folder / WEIGHTS)
    policy.record = {key: value for key, value in configuration.items() if key != "model"}
    return policy


def restore(model: ModelConfig, weights: Path, seed: int = 0) -> GraspPolicy:
    """Build a model and give it the weights of a file, all of them and no others.

    Raises:
        InputError: if the file is missing, damaged, a pickle, or another model's.
    """
    if not weights.exists():
        pickles = sorted(each.name for each in weights.parent.glob("*") if each.suffix in PICKLES)
        raise InputError(
            f"{weights.parent} has no {weights.name}"
            + (f", and {pickles[0]} is not read: a pickle can run code when it is; save it again" if pickles else "")
        )
    check_weights(weights, model)
    policy = build(model.untrained(), seed)
    try:
        policy.load_state_dict(load_tensors(weights.read_bytes()), strict=True)
    except SafetensorError as error:
        raise damaged(weights, error) from None
    except RuntimeError as error:
        reason = " ".join(line.strip() for line in str(error).splitlines()[1:])[:200]
        raise damaged(weights, reason) from None
    policy.config = model
    return policy.eval()


def read_by(model: ModelConfig, text_encoder: str) -> ModelConfig:
    """The config with its text encoder's weights in another place; InputError if that is another encoder."""
    own, given = model.encoder.partition(":")[0], text_encoder.partition(":")[0]
    if given != own:
        raise InputError(f"{model.name} was trained with the text encoder {own!r} and cannot read by {text_encoder!r}")
    return replace(model, text_encoder=text_encoder)


def check_is_known(name: str, configuration: Mapping[str, Any]) -> None:
    """Raise an InputError if a fetched config would import a module that its reader has not imported by themselves."""
    model = configuration.get("model")
    family = str(model.get("family", "")) if isinstance(model, dict) else ""
    module = family.partition(":")[0]
    if ":" in family and module not in sys.modules:
        raise InputError(
            f"{name} is of its author's own family {family}, and a downloaded file chooses no code: "
            f"`import {module}` before loading it, if you have it and trust it"
        )


def portable(config: ModelConfig) -> ModelConfig:
    """The config with local files by their names alone: where they lie on this machine is nobody's business."""
    config = replace(config, text_encoder=portable_encoder(config.text_encoder))
    if isinstance(config, ClipConfig):
        config = replace(config, clip_weights=Path(config.clip_weights).name)
    return config


def portable_encoder(encoder: str) -> str:
    """A text encoder with the local file of its weights by its name alone."""
    name, colon, file = encoder.partition(":")
    return name + colon + Path(file).name
