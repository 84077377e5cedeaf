"""File of the reference that a running robot is compared with."""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Literal

from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole
from wattwalk_core.quoting import quoted
from wattwalk_core.schema import read, schema
from wattwalk_core.yaml_file import dump_yaml

from power_estimator.live.sequential_test import ReferenceNoise


@schema
class WatchReference:
    """Noise of each drive about a model, in blocks of so many seconds."""

    format: Literal['watch_reference/1']
    model: str
    block: int
    drives: Mapping[str, ReferenceNoise]

    @classmethod
    def load(cls, path: Path, model: str, block: int) -> 'WatchReference | None':
        """Read a file, None where there is none; InputError for one of another model."""
        if not path.exists():
            return None
        found = read(cls, path, 'reference')
        if (found.model, found.block) != (model, block):
            raise InputError(
                f'reference {path} is of the model {quoted(found.model)} in blocks of '
                f'{found.block} s, not of {quoted(model)} in {block} s: name another file'
            )
        return found

    def save(self, path: Path) -> None:
        """Write the file, whole or not at all."""
        drives = {
            name: {k: list(v) if isinstance(v, tuple) else v for k, v in asdict(own).items()}
            for name, own in self.drives.items()
        }
        content = {'format': self.format, 'model': self.model, 'block': self.block}
        write_whole(path, dump_yaml({**content, 'drives': drives}))
