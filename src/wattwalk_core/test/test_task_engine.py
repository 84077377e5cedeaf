"""Task engine: results, lost workers, errors and schedulers, on real clusters on loopback."""

import os
import signal
import socket
import time
from contextlib import suppress
from multiprocessing import active_children
from pathlib import Path

import pytest
from distributed import LocalCluster
from wattwalk_core.engine.options import Workplace
from wattwalk_core.engine.task_engine import TaskEngine
from wattwalk_core.errors import InputError

OWN = ('wattwalk_core.engine',)
LISTENING = '0A'
"""State in /proc/net/tcp."""


def squared(number):
    return number * number


def process_after(seconds):
    time.sleep(seconds)
    return os.getpid()


def refused(number):
    if number == 2:
        raise InputError(f'{number} is too much')
    return number


def refused_after(seconds):
    time.sleep(seconds)
    raise InputError(f'after {seconds} s')


def ended(number):
    if number == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def thread_limits(_):
    return {name: os.environ.get(f'{name}_NUM_THREADS') for name in ('OMP', 'OPENBLAS', 'NUMBA')}


@pytest.fixture(scope='module')
def two():
    with TaskEngine(Workplace(2)) as engine:
        yield engine


def test_one_worker_is_this_process():
    with TaskEngine(Workplace(1)) as engine:
        assert list(engine.completed(process_after, [0, 0])) == [
            (0, os.getpid()),
            (1, os.getpid()),
        ]


def test_a_single_task_begins_no_other_process():
    with TaskEngine(Workplace(2)) as engine:
        assert list(engine.completed(process_after, [0])) == [(0, os.getpid())]


def test_results_come_with_the_places_of_their_items_and_in_order_where_that_is_wanted(two):
    items = list(range(20))
    found = dict(two.completed(squared, items))
    assert [found[place] for place in items] == [n * n for n in items]
    assert list(two.in_order(squared, items)) == [n * n for n in items]


def test_tasks_run_in_other_processes_with_one_thread_each(two):
    found = {pid for _, pid in two.completed(process_after, [0.05] * 8)}
    assert len(found) == 2
    assert os.getpid() not in found
    ((_, limits), _) = two.completed(thread_limits, [0, 0])
    assert set(limits.values()) == {'1'}


def test_tasks_of_a_killed_worker_run_again(two):
    killed, places, others = 0, [], set()
    for place, pid in two.completed(process_after, [0.2] * 8):
        if not killed:
            killed = pid
            os.kill(pid, signal.SIGKILL)
        places.append(place)
        others.add(pid)
    assert sorted(places) == list(range(8))
    assert len(others) >= 2


def test_an_error_of_a_task_comes_out_as_it_was_raised(two):
    with pytest.raises(InputError, match=r'^2 is too much$'):
        list(two.completed(refused, range(4)))
    assert len(list(two.completed(refused, [0, 1]))) == 2


def test_in_order_the_error_of_the_first_item_is_raised(two):
    with pytest.raises(InputError, match=r'after 0\.4 s'):
        list(two.in_order(refused_after, [0.4, 0.0]))


def test_a_task_that_no_worker_survives_is_refused_in_one_line(two):
    with pytest.raises(InputError, match='every worker that took it was lost') as refusal:
        list(two.completed(ended, range(4)))
    assert '\n' not in str(refusal.value)


def test_nothing_listens_beyond_loopback(two):
    list(two.completed(squared, [1, 2]))
    processes = [os.getpid(), *(child.pid for child in active_children())]
    assert len(processes) >= 3
    sockets = set()
    for link in (link for pid in processes for link in Path(f'/proc/{pid}/fd').iterdir()):
        with suppress(FileNotFoundError):  # closed meanwhile
            sockets.add(os.readlink(link))
    tables = [Path(f'/proc/self/net/{name}').read_text() for name in ('tcp', 'tcp6')]
    rows = [line.split() for table in tables for line in table.splitlines()[1:]]
    hosts = {
        row[1].partition(':')[0]
        for row in rows
        if row[3] == LISTENING and f'socket:[{row[9]}]' in sockets
    }
    assert hosts == {'0100007F'}


def test_a_local_cluster_opens_to_its_own_key_alone(two):
    list(two.completed(squared, [1, 2]))
    address = two._cluster.scheduler_address
    assert address.startswith('tls://127.0.0.1:')
    place = Workplace(scheduler=address)
    with pytest.raises(InputError, match='no certificates'), TaskEngine(place) as other:
        list(other.completed(squared, [1, 2], OWN))


@pytest.mark.parametrize(
    ('given', 'said'),
    [
        ({'workers': 0}, '1..256'),
        ({'workers': 257}, '1..256'),
        ({'scheduler': 'localhost:8786'}, 'tcp://HOST:PORT'),
        ({'scheduler': 'http://localhost:8786'}, 'tcp://HOST:PORT'),
        ({'scheduler': 'tcp://localhost:8786', 'workers': 2}, 'processes of this machine'),
    ],
)
def test_a_place_that_is_none_is_refused(given, said):
    with pytest.raises(InputError, match=said.replace('.', r'\.')):
        Workplace(**given)


def test_a_scheduler_that_does_not_answer_is_refused_in_one_line():
    with socket.socket() as free:
        free.bind(('127.0.0.1', 0))
        address = f'tcp://127.0.0.1:{free.getsockname()[1]}'
        with pytest.raises(InputError, match='no scheduler answers there') as refusal:
            list(TaskEngine(Workplace(scheduler=address)).completed(squared, [1, 2], OWN))
    assert '\n' not in str(refusal.value)


@pytest.fixture(scope='module')
def cluster():
    made = LocalCluster(
        n_workers=1,
        threads_per_worker=1,
        dashboard_address='127.0.0.1:0',
        memory_limit=0,
    )
    with made:
        yield made


def test_a_scheduler_does_the_work_and_stays_and_its_dashboard_is_named(cluster):
    lines = []
    for _ in range(2):
        place = Workplace(scheduler=cluster.scheduler_address)
        with TaskEngine(place, lines.append) as engine:
            assert list(engine.in_order(squared, [1, 2, 3], OWN)) == [1, 4, 9]
    assert [line.startswith('dashboard: http://127.0.0.1:') for line in lines] == [True, True]


def test_workers_with_other_code_are_refused(cluster, monkeypatch):
    from wattwalk_core.engine import task_engine

    monkeypatch.setattr(task_engine, '_installed', lambda code: 'Python 2.7')
    engine = TaskEngine(Workplace(scheduler=cluster.scheduler_address), lambda line: None)
    with engine, pytest.raises(InputError, match='install the same on both'):
        list(engine.completed(squared, [1, 2], OWN))
