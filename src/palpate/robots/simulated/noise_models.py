"""The sensor worlds there are, by name: palpate's own, and those that other packages bring.

`none`: perfect. `lab`: noise, residual friction and drift of the joint torque signals. `datasheet`:
`lab` and what the manufacturer's accuracy figures leave open.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from palpate.errors import unknown_name
from palpate.extensions import extensions, public
from palpate.robots.description import RobotDescription
from palpate.robots.simulated.noise import Imperfections

GROUP = "palpate.noise"


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """A sensor world: what `--noise` calls it, and its figures for an arm."""

    name: str
    imperfections: Callable[[RobotDescription], Imperfections]


@dataclass(frozen=True, slots=True)
class NoiseModels:
    """Sensor worlds by name."""

    models: Mapping[str, NoiseModel]

    def check(self, name: str) -> None:
        """Raises InputError when there is no such model; the message lists those there are."""
        if name not in self.models:
            raise unknown_name("noise", name, self.models)

    def imperfections(self, name: str, arm: RobotDescription) -> Imperfections:
        """The figures of the sensor world `name` for an arm.

        Raises:
            InputError: as `check`.
        """
        self.check(name)
        return self.models[name].imperfections(arm)


def perfect(_: RobotDescription) -> Imperfections:
    """Every signal is true, and every link as the nominal model has it."""
    return Imperfections(torque_noise=np.zeros(7), friction=np.zeros(7))


def lab(arm: RobotDescription) -> Imperfections:
    """A well kept arm; the figures and their sources stand in its description."""
    sensors = arm.sensors
    return Imperfections(sensors.torque_noise, sensors.friction, drift=sensors.drift)


def datasheet(arm: RobotDescription) -> Imperfections:
    """All that the manufacturer's accuracy figures allow."""
    return replace(
        lab(arm),
        repeatability=arm.nominal.force_repeatability,
        pose_repeatability=arm.nominal.pose_repeatability,
        gain=arm.nominal.torque_gain,
        link_mass=arm.sensors.link_mass,
        link_com=arm.sensors.link_com,
    )


OWN = (NoiseModel("none", perfect), NoiseModel("lab", lab), NoiseModel("datasheet", datasheet))


@cache
def noise_models() -> NoiseModels:
    """Palpate's own sensor worlds, and every public `NoiseModel` of the modules in the entry-point
    group `palpate.noise`. Palpate's own names cannot be taken.

    Raises:
        InputError: an entry point's module cannot be loaded; the message names it.
    """
    found = {model.name: model for model in OWN}
    for module in extensions(GROUP):
        for thing in public(module):
            if isinstance(thing, NoiseModel):
                found.setdefault(thing.name, thing)
    return NoiseModels(found)
