"""Nodes that live and end as one, tried with shell scripts in the place of nodes."""

import signal

import pytest
from rich.console import Console
from wattwalk_bringup.commands.live import node_table, print_news
from wattwalk_bringup.node_group import LogFollower, NodeGroup
from wattwalk_bringup.node_set import NodeCommand
from wattwalk_core.errors import InputError
from wattwalk_core.processes import wait_until

from wattwalk_bringup import node_group

WAITS = 'trap "echo $0 ends; exit 0" INT\necho ready\nwhile :; do sleep 0.05; done\n'
DEAF = 'trap "" INT TERM\necho ready\nwhile :; do sleep 0.05; done\n'


@pytest.fixture
def start(tmp_path, monkeypatch):
    """Starts a group of scripts by their names and waits until each has said something."""
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    folder = tmp_path / 'lib' / 'scripts'
    folder.mkdir(parents=True)
    groups = []

    def started(**scripts):
        for name, text in scripts.items():
            (folder / name).write_text(f'#!/bin/sh\n{text}')
            (folder / name).chmod(0o755)
        group = NodeGroup([NodeCommand(name, 'scripts', name) for name in scripts], tmp_path)
        groups.append(group)
        assert wait_until(lambda: all(node.process.output for node in group.nodes))
        return group

    yield started
    for group in groups:
        group.kill()


def test_the_policy_runner_ends_first_then_the_recorder_then_the_rest(start):
    group = start(daq=WAITS, policy=WAITS, recorder=WAITS)
    order = []

    def look():
        order.extend(
            node.name
            for node in group.nodes
            if not node.process.running and node.name not in order
        )

    group.end(look)
    assert order == ['policy', 'recorder', 'daq']
    assert group.failures() == []


def test_a_node_that_does_not_end_is_killed_and_told(start, monkeypatch):
    monkeypatch.setattr(node_group, 'PATIENCE', ((signal.SIGINT, 0.2), (signal.SIGTERM, 0.2)))
    group = start(policy=WAITS, daq=DEAF)
    group.end(lambda: None)
    assert group.failures() == ['daq failed with code -9: ready']


def test_a_node_in_a_hurry_may_still_say_its_last_word_and_a_deaf_one_is_killed(
    start, monkeypatch
):
    monkeypatch.setattr(node_group, 'HURRIED', 0.5)
    last = 'trap "echo damping; exit 0" TERM\necho ready\nwhile :; do sleep 0.05; done\n'
    group = start(policy=last, daq=DEAF)
    group.kill()
    policy, daq = (node.process for node in group.nodes)
    assert policy.output.split()[-1] == 'damping'
    assert policy.returncode == 0
    assert daq.returncode == -signal.SIGKILL


def test_the_node_that_failed_is_named_with_its_last_line(start):
    group = start(sim=WAITS, daq='echo reading\necho "no bus can9" >&2\nexit 2\n', policy=WAITS)
    assert wait_until(lambda: group.ended)
    assert group.ended.name == 'daq'
    assert group.failures() == ['daq failed with code 2: no bus can9']
    group.end(lambda: None)
    assert not any(node.process.running for node in group.nodes)


def test_nothing_is_started_where_a_package_is_missing(start, tmp_path):
    start(sim=WAITS)
    commands = [NodeCommand('a', 'scripts', 'sim'), NodeCommand('b', 'absent', 'b')]
    with pytest.raises(InputError, match='package absent'):
        NodeGroup(commands, tmp_path)
    assert not (tmp_path / 'a.log').exists()


class Shown:
    """The place of a terminal."""

    def update(self, table):
        console = Console(width=120)
        with console.capture() as captured:
            console.print(table)
        self.text = captured.get()


def test_the_table_shows_state_and_last_line_of_each_node(start):
    group = start(sim=WAITS, daq='echo "[WARN] [17.5] [power_daq]: bus absent"\nexit 3\n')
    assert wait_until(lambda: group.ended)
    shown = Shown()
    shown.update(node_table(group.nodes))
    rows = {line.split()[0]: line for line in shown.text.splitlines() if line.strip()}
    assert 'running' in rows['sim']
    assert 'ready' in rows['sim']
    assert 'failed, code 3' in rows['daq']
    assert 'warn: bus absent' in rows['daq']


def test_a_node_starts_until_it_has_said_something(start):
    (sim,) = start(sim=WAITS).nodes
    assert sim.state == 'starting'
    assert sim.update() == ['ready']
    assert sim.state == 'running'


def test_without_a_terminal_each_line_is_printed_once_after_the_name(start, capsys):
    group = start(daq='echo one\necho two\nexit 3\n')
    assert wait_until(lambda: group.ended)
    assert group.failures() == ['daq failed with code 3: two']
    states = {}
    print_news(states, group.nodes)
    print_news(states, group.nodes)
    assert capsys.readouterr().out.splitlines() == ['daq: one', 'daq: two', 'daq: failed, code 3']


def test_a_line_is_read_when_it_is_whole_and_the_last_one_at_the_end(tmp_path):
    path = tmp_path / 'a.log'
    path.write_bytes(b'')
    follower = LogFollower(path)
    with path.open('ab', buffering=0) as log:
        log.write(b'\x1b[33mone\x1b[0m\n\ntw')
        assert follower.new_lines() == ['one']
        log.write(b'o\n[INFO] [1.25] [daq]: thr')
        assert follower.new_lines() == ['two']
        log.write(b'ee')
    assert follower.rest() == ['three']
    assert follower.rest() == []
    assert follower.last == 'three'
