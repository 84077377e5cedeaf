"""Recordings of a unit that ages, one for each day of its plan."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path

from wattwalk_core.engine.task_engine import TaskEngine
from wattwalk_core.errors import InputError

from sim_bridge.offline.run import walking_run, write_bag
from sim_bridge.plant.ageing import AgeingPlan
from sim_bridge.plant.parameters import Plant

_NOON = 12  # h


def record_history(
    plan: AgeingPlan, folder: Path, engine: TaskEngine, prefix: str = 'day'
) -> Iterator[Path]:
    """Write a recording for each day of a plan, in their order, and yield its path.

    Cards have the date, temperature, terrain, controller and payload, and nothing of the wear.
    The recordings do not depend on the number of workers. InputError for a plant that is not there
    or a folder that has a recording of a day already.
    """
    plant = Plant.load(plan.plant)
    bags = [folder / name for name in bag_names(plan, prefix)]
    for bag in bags:
        if bag.exists():
            raise InputError(f'{bag} is there already; give another folder')
    folder.mkdir(parents=True, exist_ok=True)
    task = partial(_record_day, plan, plant, [bag.absolute() for bag in bags])
    for place in engine.in_order(task, range(len(bags))):
        yield bags[place]


def bag_names(plan: AgeingPlan, prefix: str = 'day') -> list[str]:
    """Return the folder names of a plan's recordings: prefix, number and day."""
    return [f'{prefix}_{index:03d}_{day.day:g}' for index, day in enumerate(plan.days)]


def _record_day(plan: AgeingPlan, plant: Plant, bags: Sequence[Path], index: int) -> int:
    day = plan.days[index]
    run = walking_run(
        plan.aged(plant, day),
        duration=plan.seconds,
        seed=(plan.seed * 100_003 + index) % 2**31,
        controller=day.controller,
        terrain=day.terrain,
        drives=plan.drives,
        payload=day.payload,
    )
    start = datetime.fromisoformat(plan.start).replace(hour=_NOON, tzinfo=UTC)
    card = run.card(
        'anymal_c',
        terrain=day.terrain,
        notes='simulated',
        temperature=day.temperature,
        payload=day.payload,
    )
    created = (start + timedelta(days=day.day)).isoformat()
    # A worker that was lost may have begun it.
    write_bag(bags[index], run, replace(card, created=created), overwrite=True)
    return index
