"""An arm with what was measured of it: description < datasheet < robot.yaml."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from palpate.robots.description import Limits, RobotDescription, reflexes
from palpate.robots.owner.config import Gains, RobotConfig
from palpate.robots.owner.datasheet import Datasheet, informed
from palpate.robots.sheet import Cautious, Pace
from palpate.trace.recording import Hand


@cache
def calibrated(arm: RobotDescription, config: RobotConfig) -> RobotDescription:
    """The arm as its owner knows it who has measured it. One and the same for the same figures."""
    return replace(
        arm,
        nominal=_hand(arm.nominal, config),
        limits=_limits(arm, config),
        stiffness=config.stiffness or arm.stiffness,
        pace=_pace(arm.pace, config.speed),
        end_effector=config.end_effector or arm.end_effector,
        config=config,
        told=arm,
    )


def known(arm: RobotDescription, sheet: Datasheet) -> RobotDescription:
    """The arm as its owner knows it, who has the datasheet `sheet`."""
    if arm.told is None or arm.config is None:
        return informed(arm, sheet)
    return calibrated(informed(arm.told, sheet), arm.config)


def unmeasured(arm: RobotDescription) -> RobotDescription:
    """The same arm without what was measured of it."""
    return arm.told or arm


@cache
def as_measured(arm: RobotDescription) -> RobotDescription:
    """An arm that is what was measured, with sensors that need no correction: to predict with."""
    return replace(arm, config=None, told=None)


def _hand(hand: Hand, config: RobotConfig) -> Hand:
    tip, soft, gains = config.tip_offset, config.tip_compliance, config.torque_gain
    if tip is not None:
        hand = replace(hand, tip_offset=tip.value, tip_offset_std=tip.std)
    if config.pose_repeatability is not None:
        hand = replace(hand, pose_repeatability=config.pose_repeatability.value)
    if soft is not None:
        hand = replace(hand, tip_compliance=soft.value, tip_compliance_std=soft.std)
    if gains is not None:
        hand = _gauged(hand, gains)
    return hand


def _gauged(hand: Hand, gains: Gains) -> Hand:
    """With what is left of the gains' errors once they are corrected; `torque_gain`, one figure for
    all joints, is that of the worst of them."""
    left = gains.spread / np.outer(1.0 + gains.value, 1.0 + gains.value)
    rows = tuple(tuple(row) for row in left.tolist())
    worst = float(np.sqrt(3.0 * left.diagonal().max()))
    return replace(hand, torque_gain=worst, gain_covariance=rows)


def _limits(arm: RobotDescription, config: RobotConfig) -> Limits:
    limits, fence = arm.limits, config.workspace
    if fence is not None:
        limits = replace(
            limits,
            workspace_min=np.maximum(limits.workspace_min, fence.min),
            workspace_max=np.minimum(limits.workspace_max, fence.max),
        )
    if config.reflex is not None:
        limits = replace(limits, reflexes=reflexes(config.reflex, limits.payload))
    return limits


def _pace(pace: Pace, part: float | None) -> Pace:
    """All speeds, cautious ones too; how fast they are reached stays."""
    if part is None:
        return pace
    cautious = {name: getattr(pace.cautious, name) * part for name in Cautious.model_fields}
    speeds = {
        "speed": pace.speed * part,
        "turning_speed": pace.turning_speed * part,
        "joint_speed": pace.joint_speed * part,
        "cautious": Cautious(**cautious),
    }
    return pace.model_copy(update=speeds)
