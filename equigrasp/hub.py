"""Files from the Hugging Face hub: from its cache, or the network. Costs no huggingface_hub until used."""

from __future__ import annotations

import socket
import urllib.parse
import urllib.request
from pathlib import Path

from equigrasp.errors import InputError

PORTS = {"http": 80, "https": 443, "socks5": 1080, "socks5h": 1080}


def reaches(url: str, seconds: float = 1.5) -> bool:
    """Whether a server (or the proxy before it) answers: huggingface_hub alone would retry for 47 s."""
    target = urllib.parse.urlsplit(url)
    proxies = urllib.request.getproxies()
    proxy = proxies.get(target.scheme) or proxies.get("all")
    if proxy and not urllib.request.proxy_bypass(target.netloc):
        target = urllib.parse.urlsplit(proxy if "://" in proxy else f"http://{proxy}")
    port = target.port or PORTS.get(target.scheme, PORTS["https"])
    try:
        with socket.create_connection((target.hostname or "", port), timeout=seconds):
            return True
    except OSError:
        return False


def is_online() -> bool:
    """Whether the hub may be asked ($HF_HUB_OFFLINE) and answers."""
    from huggingface_hub import constants

    return not constants.HF_HUB_OFFLINE and reaches(constants.ENDPOINT)


def check_id(name: str) -> None:
    """Raise an InputError unless this is how models are named on the hub: "user/name"."""
    from huggingface_hub.errors import HFValidationError
    from huggingface_hub.utils import validate_repo_id

    try:
        validate_repo_id(name)
    except HFValidationError:
        raise InputError(f"{name!r} is neither a folder here nor the id of a model on the hub (user/name)") from None


def check_can_push(repo_id: str) -> None:
    """Raise an InputError, within two seconds, unless this names a model and the hub answers."""
    check_id(repo_id)
    if not is_online():
        raise InputError(
            f"{repo_id} cannot be pushed: the hub does not answer (no network, or HF_HUB_OFFLINE); the folder alone "
            "needs none, and `hf upload` pushes it later"
        )


def fetch(
    repository: str,
    files: tuple[str, ...],
    *,
    revision: str | None = None,
    cache_dir: str | Path | None = None,
    force_download: bool = False,
    local_files_only: bool = False,
    token: str | bool | None = None,
) -> Path:
    """The local folder that holds these files of a repository, fetched or brought up to date if the hub answers.

    Raises:
        InputError: within two seconds, if the id cannot be, or the files are not in the cache and there is no
            network; or if the hub has no such repository or file, or refuses.
    """
    from huggingface_hub import hf_hub_download
    from huggingface_hub.errors import EntryNotFoundError, LocalEntryNotFoundError

    check_id(repository)
    offline = local_files_only or not is_online()
    path = Path()
    for file in files:
        try:
            path = Path(
                hf_hub_download(
                    repository,
                    file,
                    revision=revision,
                    cache_dir=cache_dir,
                    force_download=force_download and not offline,
                    local_files_only=offline,
                    token=token,
                )
            )
        except LocalEntryNotFoundError:
            raise InputError(
                f"there is no folder {repository} here, {file} of the hub's {repository} is not in this machine's "
                "cache, and the hub cannot be asked (no network, or HF_HUB_OFFLINE); name a folder, or fetch it once "
                f"with `hf download {repository}` where there is a network"
            ) from None
        except EntryNotFoundError:
            raise InputError(
                f"{repository} on the hub has no {file}; a policy is a config.json and a model.safetensors, and "
                "pickles (.bin, .pt) are not read, because one that is read can run code"
            ) from None
        except OSError as error:
            raise InputError(
                f"{file} of {repository} cannot be fetched from the hub ({type(error).__name__}); does the model "
                "exist, and are you logged in (`hf auth login`) if it is private?"
            ) from None
    return path.parent
