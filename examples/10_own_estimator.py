"""An estimator of your own: a function from a trace to an estimate, beside palpate's on the same recording."""

from pathlib import Path

import palpate as pp


def mean_force(trace, parameter, body):
    """F_z over g, without any comparison: what an arm that feels nothing else would weigh."""
    recording = trace.converted(parameter)
    masses = trace.of(recording).wrench[:, 2] / trace.gravity
    return pp.Estimate.normal(parameter, "kg", masses.mean(), masses.std(), "Mean of F_z/g.")


scene = pp.load(Path(__file__).with_name("desk.xml"))
run = scene.plan("how heavy is the mug?").run(noise="datasheet", seed=0)

parameter = pp.Parameter("mug.mass")
print("truth:    ", *run.truth[parameter])
print("palpate:  ", run[parameter])
print("bare mean:", mean_force(run.trace, parameter, scene.body("mug")))
