"""Folders of learned policies by name, folder or training run."""

from pathlib import Path

from policy_runner.policies.by_name import SHIPPED, shipped
from wattwalk_core.errors import InputError

from policy_training.config import POLICY


def learned_folder(source: str) -> Path:
    """Return the folder of a learned policy; InputError if there is none."""
    if source in shipped():
        return SHIPPED / source
    folder = Path(policy_source(source))
    if folder.is_dir():
        return folder
    raise InputError(
        f'no learned policy {source!r}; there are {", ".join(shipped())}, or give a policy folder'
    )


def policy_source(source: str) -> str:
    """Return the policy folder of a training run; other sources unchanged."""
    inner = Path(source) / POLICY
    return str(inner) if inner.is_dir() else source
