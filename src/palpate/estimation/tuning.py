"""Every tuning number of the estimators: its value, its unit, why it has it, how sensitive it is.

What an arm or a hand is known for (the tips' length, the datasheet's accuracies) is not tuned: it
comes with the trace, in `trace.hand`.
"""

from __future__ import annotations

import numpy as np

# Cutting a trace into rests and passes.

SETTLE = 0.15
"""s after the commanded pose stopped moving: the impedance controller's transient."""

START = 0.06
"""s before the commanded pose moves on: a smooth start accelerates before it visibly moves."""

STILL_SPEED = 0.001
"""m/s: below this the TCP counts as at rest."""

NEAR = 0.012
"""m off the measured pose that a rest may be and still count as the same pose (a loaded arm sags by
m g / k)."""

NEAR_ANGLE = 0.06
"""rad, likewise."""

CORRIDOR = 0.02
"""m beside the line from the grasp to the measured pose that a pass may run."""

CLEARANCE = 0.015
"""m of the path above the grasp left out: there the support may still carry part of the object."""

SHORT_LIFT = 0.4
"""Part of a short lift that is left out instead."""

COVERED = 0.4
"""Part of the lift that a pass must cover."""

LIFT_MIN = 0.02
"""m: a lift shorter than this is no path to compare passes on."""

REST_ROWS = 5
"""Rows that make a rest."""

ARRIVAL = 0.02
"""m: the last stretch before a rest, whose direction tells how the joints' friction was left."""

ALONG = 0.7
"""Cosine between that stretch and the path from which the rest was reached along the path."""

PASS_SPEED = 0.01
"""m/s along the path from which the joints certainly slide."""

SAME_MOTION = 0.25
"""m/s², root mean square along the path: passes whose accelerations differ by more are not
compared."""

BINS = 10
"""Bins along the path, so that all passes are compared at the same configurations."""

BLOCK = 0.1
"""s: samples are averaged over blocks of this length before their scatter is taken, so correlation
counts."""

TREND = 1
"""Degree of the trend in time that is taken out of a rest before its scatter is taken."""

UNKNOWN_NOISE = 0.01
"""N², (N m)²: variance of a row where no rest is long enough to show it."""

# The load from the contrast of rests and passes.

FORCE_BIAS = 0.5
"""N (1 sigma): bias of an unreferenced force; Franka states 0.8 N relative accuracy."""

TORQUE_LEVER = 0.3
"""m: what turns the force figures here into moments about the TCP (typical lever of the arm's wrist
joints)."""

KIND_BIAS = 0.3
"""N (1 sigma): how far the bias of one kind of segment lies from the common one (friction
hysteresis)."""

PASS_SCATTER = 0.003
"""N: prior scale of the scatter between passes; joints that slide hold no stick residual."""

REST_GRID = np.geomspace(0.02, 0.8, 12)
"""N: scatter between rests that is integrated over."""

PASS_GRID = np.geomspace(0.001, 0.1, 10)
"""N: scatter between passes that is integrated over."""

ROUGH_SCATTER = 0.02
"""N: scatter of segments in the first fit, which only shows what the model leaves out."""

DRIFT = 0.001
"""N/s (1 sigma)."""

APPARENT_MASS = (6.0, 3.0)
"""kg, mean and 1 sigma: apparent vertical mass of a 7-axis arm at its TCP."""

CROSS_INERTIA = 0.5
"""Part of that 1 sigma by which a vertical acceleration shows in the other components."""

CENTRIFUGAL = 8.0
"""N s²/m² (1 sigma): how much two passes differ whose squared speeds differ; equal motions compare
best."""

DEGREE = 3
"""Of the polynomial along the path that the bias of one direction of travel follows."""

CORRELATED_BINS = 3.0
"""What the model of a pass leaves out is the same in about so many neighbouring bins."""

FLOOR = 1e-4
"""N: noise that is always assumed."""

LOAD_PRIOR = 1e3
"""N (1 sigma) of the load: nothing is known of it."""

GAIN_AVERAGE = 0.7
"""Two joints carry a vertical load about equally; the gain errors of both average to 1/sqrt(2) of
one."""

# Centre of mass.

GRASP_ACCURACY = 7e-4
"""m (1 sigma): how far a grasp may shift the object from where it is believed to be in the hand."""

GAIN_LEVER = 0.3
"""m: unequal gains of the joints' torque sensors make a pure force look as if it acted off the TCP,
by the gain's standard deviation times about so much; the same at all grasps."""

COM_PRIOR = 0.25
"""Part of the object's extent that is the 1 sigma of a coordinate of the centre of mass before
measuring."""

BLIND = 0.5
"""Part of that 1 sigma that must be left for a coordinate to count as not measured."""

# Height: the loading curve of a guarded descent.

STOPPED = 0.3
"""Part of the approach speed below which the tip counts as stopped by something much stiffer than
the arm."""

TOUCH = 0.15
"""Part of the pressing force from which the curve is trusted to be contact and not noise."""

KNEES = (TOUCH, 0.3, 0.45, 0.6, 0.75)
"""Parts of the pressing force at which the stiff part may begin."""

SPAN = 0.25
"""Part of the pressing force by which it must rise while the tip stands for the surface to be
stiff."""

CURVE_ROWS = 5
"""Rows that make a line."""

INTERVALS = 8
"""Intervals of force that weigh the same in a line."""

HALTED = 0.5
"""Part of the descent's speed that must still be commanded for a stop to be the surface's doing."""

LIFT_OFF = 0.002
"""m above where it was held: there the tip has left the surface."""

UNSEEN = 2e-5
"""m (1 sigma): penetration of a rigid surface where the force did not vary enough to see it."""

STRAIGHT = 5e-5
"""m: largest residual (rms) of the stiff part about its line."""

RIGID = 2e-4
"""m/N: what gives way more than this is not a rigid surface."""

SOFT = 0.0015
"""m above the rigid surface from which an earlier rise of the force is something soft."""

SOFT_ACCURACY = 2e-3
"""m (1 sigma): what is soft has no sharp beginning."""

SOFT_SMOOTH = 7
"""Rows over which the force is averaged before its first rise is looked for."""

SOFT_FORCE = 0.15
"""N: below this the averaged force is none."""

RETREAT = 1.5
"""s after the recording in which the unloading curve is looked for."""

CORRECTION = 0.25
"""1 sigma, relative, of the correction for penetration: contacts are not quite linear."""

# Friction: drags along a support.

DRAG_SPEED = 0.002
"""m/s, commanded and horizontal, from which a row belongs to a drag."""

DRAG_SLOPE = 0.3
"""Vertical over horizontal commanded speed up to which a motion is a drag."""

DRAG_ROWS = 20
"""Rows that a drag must exceed."""

STEADY_ROWS = 10
"""Rows of steady sliding from which a drag counts."""

CRUISE = 0.95
"""Part of the usual commanded speed from which the motion is at its full speed."""

SLIDING = 0.85
"""Part of the usual quotient of forces from which the object may be sliding: before, it turns in
the fingers' grip."""

RISE_ROWS = 6
"""Rows of the rise before the breakaway through which a line is laid."""

FOLLOWING = 0.7
"""Part of the commanded speed at which the hand follows; slower, the object may have stuck
again."""

PEAK_WITHIN = 0.3
"""s after that in which the breakaway lies."""

SMOOTH = 0.02
"""s: forces are averaged over this before the breakaway is looked for."""

TRANSIENT = 0.25
"""s after breakaway in which the spring between arm and object still swings."""

DOWN = 0.006
"""m above the grasp that the hand may be while the object is on its support."""

HANGING = 0.02
"""m above the grasp from which the object hangs free."""

DRIVE_BIAS = 0.3
"""N (1 sigma): residual of the arm's own joint friction in a horizontal force while the joints
slide."""

HORIZONTAL_MASS = 5.0
"""kg, of a 7-axis arm at its TCP, horizontally: what its acceleration at breakaway takes of the
force."""

GAIN_RATIO = 0.8
"""A quotient of two forces that different joints carry: sqrt(2) times a gain uniform within its
half width."""

NORMAL_MIN = 0.5
"""N: below this the quotient of forces says nothing."""

CORRELATION = 10.0
"""Rows of a drag per independent one: stick-slip and the arm's own swing correlate over a tenth of
a second."""

SIGNIFICANT = 2.0
"""Standard deviations from zero from which a friction is identified."""

# Position.

CENTRING = 0.0015
"""m (1 sigma): fingers centre an object on themselves as they close; in simulated grasps it ended
up to 2.5 mm from where it had stood."""
