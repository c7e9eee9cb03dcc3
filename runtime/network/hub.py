"""Bundles on the Hugging Face hub; needs the extra [hub], which is huggingface-hub."""

from __future__ import annotations

import re
from os import PathLike
from pathlib import Path

from runtime.errors import BundleError, extra
from runtime.network.manifest import MANIFEST_FILE

HUB = re.compile(r"hf:/{1,2}([\w.-]+/[\w.-]+)(?:@([\w./-]+))?", flags=re.ASCII)
"""hf://user/name, or hf://user/name@revision; a path has lost one of the slashes."""

FILES = (MANIFEST_FILE, "*.onnx", "*.safetensors")
"""What is fetched: what planning and training on need."""


def is_on_hub(path: str | PathLike[str]) -> bool:
    """Return whether a bundle is named by its place on the hub."""
    return str(path).startswith("hf:/")


def fetch(path: str | PathLike[str]) -> Path:
    """Return the folder of a bundle on the hub, fetched unless this machine has it already.

    Args:
        path: hf://user/name, or with a branch, a tag or a commit hf://user/name@revision.

    Raises:
        BundleError: it is no such name, there is no such bundle, or the hub cannot be reached and it is not here yet.
        MissingExtraError: huggingface-hub is not installed.
    """
    match = HUB.fullmatch(str(path))
    if match is None:
        raise BundleError(f"{path}: a bundle on the Hugging Face hub is hf://user/name or hf://user/name@revision")
    with extra("hub"):
        from huggingface_hub import snapshot_download
        from huggingface_hub.errors import HfHubHTTPError
    name, revision = match.groups()
    try:
        return Path(snapshot_download(name, revision=revision, allow_patterns=list(FILES)))
    except (HfHubHTTPError, OSError, ValueError) as error:
        raise BundleError(f"hf://{name}: cannot be fetched: {str(error).partition(chr(10))[0]}") from error
