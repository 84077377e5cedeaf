import subprocess
import sys

BROKEN = """
import sys
from sim_bridge.live.real_time import LivePlant

def run(self, stop):
    raise LookupError('no such joint')

LivePlant.run = run
from sim_bridge.commands.arguments import sim as main
sys.exit(main())
"""


def test_a_fault_of_the_plant_ends_the_node_with_its_traceback(ros_domain, tmp_path):
    bus = ('-p', 'interface:=unixsocket', '-p', f'channel:={tmp_path}/bus')
    done = subprocess.run(
        [sys.executable, '-c', BROKEN, '--ros-args', *bus],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 1
    assert 'Traceback' in done.stderr
    assert "raise LookupError('no such joint')" in done.stderr or ', in run' in done.stderr
    assert done.stderr.rstrip().endswith('LookupError: no such joint')
