"""Notes of a session: what was seen at a running robot, and when."""

import datetime
from pathlib import Path

from wattwalk_core.files import write_whole
from wattwalk_core.yaml_file import dump_yaml, read_yaml

FILE = 'notes.yaml'


def keep_note(folder: Path, text: str, recording: str) -> None:
    """Add a note to the session's file, with the recording whose card has it, if any."""
    file = folder / FILE
    before = read_yaml(file, 'notes') if file.exists() else []
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec='milliseconds')
    entry = {'time': now, 'text': text} | ({'recording': recording} if recording else {})
    write_whole(file, dump_yaml([*before, entry]))
