"""The paper's studies of planners: ablation of the prompt (table II) and repeatability (table III)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

from palpate.common.errors import unknown_name
from palpate.planning.model.prompt import check_style
from palpate.studies.attempt import Conditions, attempt
from palpate.studies.scenarios.catalogue import scenario, scenarios
from palpate.studies.trials import PlannerTrial, TrialRecord, run_trials

# Rows of the paper's table II, with the prompt modules that each leaves out.
CONFIGURATIONS: dict[str, frozenset[str]] = {
    "full": frozenset(),
    "no image": frozenset({"image"}),
    "no text": frozenset({"text"}),
    "no role": frozenset({"role"}),
    "no actions": frozenset({"actions"}),
    "no composites": frozenset({"composites"}),
    "no rules": frozenset({"reasoning_rules", "bt_rules"}),
    "no output": frozenset({"output"}),
    "no system prompt": frozenset({"all"}),
}

# Valid syntax and task success of 10 with Gemini 1.5 Pro: table II of the paper.
ABLATION: dict[str, tuple[int, int | None]] = {
    "full": (10, 10),
    "no image": (10, 5),
    "no text": (10, None),
    "no role": (10, 10),
    "no actions": (10, 0),
    "no composites": (10, 8),
    "no rules": (10, 3),
    "no output": (0, 0),
    "no system prompt": (0, 0),
}
# Valid syntax and task success of 20: table III of the paper.
REPEATABILITY: dict[str, tuple[int, int]] = {"GPT-4": (20, 20), "Gemini 1.5 Pro": (20, 20)}

# Scenarios of several kinds. A module of the prompt that helps one of them (an obstacle, a slide,
# three grasps, a label, a refusal) may not help another.
KINDS = (
    "bottle_and_table",
    "occlusion",
    "friction",
    "hammer",
    "vision/labels",
    "water_temperature",
)
EVERY = "all"
SEVERAL = "kinds"


def chosen(names: Sequence[str]) -> list[str]:
    """Expand scenario names: `all` is every scenario with a request for a planner, `kinds` is `KINDS`."""
    selected: list[str] = []
    for name in names:
        if name == EVERY:
            selected += [each.name for each in scenarios().values() if each.asks]
        elif name == SEVERAL:
            selected += KINDS
        else:
            selected.append(scenario(name).name)
    return list(dict.fromkeys(selected))


def ablation(
    names: Sequence[str],
    planners: Sequence[str],
    file: Path,
    conditions: Conditions,
    trials: int = 10,
    configurations: Iterable[str] = CONFIGURATIONS,
    in_flight: int = 4,
    say: Callable[[str], None] = lambda _: None,
    prompts: Iterable[str] = ("full",),
) -> list[TrialRecord]:
    """Run `trials` trials of every configuration, prompt, planner and scenario; append the results to `file`."""
    # All trials share the conditions; pictures are saved next to the results.
    conditions = replace(conditions, records_file=file)
    critic = conditions.model_settings.critic or ""
    styles = [check_style(prompt) for prompt in prompts]
    each = product(chosen(names), planners, styles, configurations, range(trials))
    wanted = [
        PlannerTrial(scenario, planner, configuration, i, prompt, critic)
        for scenario, planner, prompt, configuration, i in each
    ]

    def run_attempt(trial: PlannerTrial) -> TrialRecord:
        return attempt(trial, modules_left_out(trial.configuration), conditions)

    return run_trials(wanted, run_attempt, file, in_flight, say)


def modules_left_out(configuration: str) -> frozenset[str]:
    """Prompt modules that a configuration leaves out. Raises InputError: no such configuration; the
    message lists the valid ones."""
    if configuration not in CONFIGURATIONS:
        raise unknown_name("configuration", configuration, CONFIGURATIONS)
    return CONFIGURATIONS[configuration]


def repeatability(
    names: Sequence[str],
    planners: Sequence[str],
    file: Path,
    conditions: Conditions,
    trials: int = 20,
    in_flight: int = 4,
    say: Callable[[str], None] = lambda _: None,
    prompts: Iterable[str] = ("full",),
) -> list[TrialRecord]:
    """Run `trials` trials of the whole prompt with every planner in every scenario; append the results to `file`."""
    return ablation(names, planners, file, conditions, trials, ["full"], in_flight, say, prompts)


def published_ablation() -> dict[str, str]:
    """The paper's syntax and success rates as text, by configuration."""
    return {
        name: f"{syntax}/10, {'–' if success is None else f'{success}/10'}"
        for name, (syntax, success) in ABLATION.items()
    }


def published_repeatability() -> dict[str, str]:
    """The paper's syntax and success rates as text. Equal rates of several models appear once."""
    rates = {f"{syntax}/20, {success}/20" for syntax, success in REPEATABILITY.values()}
    return {"full": "; ".join(sorted(rates))}
