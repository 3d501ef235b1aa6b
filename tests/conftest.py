"""Which tests take long: they are left out of `make test` and run by `make test-all`.

A test belongs here when it takes more than some seconds on one core: whole runs of large scenarios,
a real robot's protocol in lockstep, studies over many runs. What they are about is also asserted, for
smaller cases, by tests that are not here.
"""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatch

import pytest

LONG = (
    "tests/vocabulary/test_handle.py::test_a_drawer_is_measured_and_left_where_it_was",
    "tests/vocabulary/test_handle.py::test_a_limit_that_nobody_stated_is_met_slowly_and_said",
    "tests/scenarios/test_catalogue.py::test_a_scenario_ends_as_it_should[[]drawer*",
    "tests/examples/test_programs.py::test_a_program_runs_and_prints_what_it_promises[[]13*",
    "tests/robots/franky/test_over_the_wire.py::*",
    "tests/robots/franky/test_faults.py::*",
    "tests/robots/franky/test_command_line.py::*",
    "tests/robots/franky/test_gauges.py::*",
    "tests/scenarios/test_recorded_plans.py::test_a_recorded_plan_acquires_exactly_what_is_missing*",
    "tests/test_pipeline.py::test_every_stage_can_start_from_the_folder",
    "tests/test_pipeline.py::test_same_seed_same_result_bit_for_bit",
    "tests/execution/test_repetition.py::test_a_value_is_measured_until_it_is_as_narrow_as_asked*",
    "tests/runs/test_read.py::test_a_scene_that_was_seen_in_a_picture_is_the_one_that_contact_told",
    "tests/cli/test_stored_runs.py::test_estimates_are_made_anew",
    "tests/cli/test_stored_runs.py::test_a_twin_is_proved_and_the_report_shows_it",
    "tests/cli/test_models.py::test_bottle_and_table_end_to_end_over_http",
    "tests/cli/test_models.py::test_the_papers_tables_are_made_and_gone_on_with",
    "tests/cli/test_models.py::test_a_conversation_is_replayed_without_network",
    "tests/cli/test_models.py::test_the_answer_of_any_chat_is_checked_and_executed",
    "tests/cli/test_calibrate.py::test_a_known_weight_makes_masses_right",
    "tests/calibration/test_camera.py::test_a_tag_tells_where_the_camera_is*",
    "tests/studies/test_efficiency.py::test_one_missing_mass_takes_less_than_everything",
    "tests/studies/planners/test_ablation.py::*",
    "tests/studies/test_cluster.py::*",
    "tests/examples/test_thermometer.py::test_the_request_is_measured_and_reported",
    "tests/examples/test_thermometer.py::test_a_thermometer_that_cannot_be_read_ends*",
    "tests/examples/test_rolling_friction.py::*",
    "tests/live/test_page.py::*",
    "tests/test_tutorial.py::test_the_mug_is_measured_and_its_twin_is_read",
    "tests/cli/test_live.py::test_the_stop_button_stops_the_arm",
    "tests/cli/test_look_first.py::test_a_box_15_mm_off_its_place_is_seen_and_weighed",
    "tests/vocabulary/test_turning.py::test_a_centre_of_mass_is_found_along_gravity",
    "tests/test_api.py::test_where_the_scenes_file_is_gone_the_measurement_is_still_there",
    "tests/test_api.py::test_the_same_seed_gives_the_same_run",
    "tests/scenarios/test_rehearsals.py::*",
    "tests/scenarios/test_catalogue.py::test_a_scenario_ends_as_it_should[[]fifteen_objects]",
    "tests/scenarios/test_catalogue.py::test_a_scenario_ends_as_it_should[[]clutter]",
    "tests/scenarios/test_catalogue.py::test_a_scenario_ends_as_it_should[[]from_picture]",
    "tests/scenarios/test_catalogue.py::test_a_scenario_ends_as_it_should[[]hammer]",
    "tests/scenarios/test_catalogue.py::test_a_scenario_ends_as_it_should[[]occlusion]",
    "tests/scenarios/test_catalogue.py::test_a_scenario_ends_as_it_should[[]friction]",
    "tests/scenarios/test_catalogue.py::test_a_scenario_ends_as_it_should[[]two_of_three]",
    "tests/scenarios/test_catalogue.py::test_a_scenario_ends_as_it_should[[]hidden_geometry]",
    "tests/scenarios/test_catalogue.py::test_a_scenario_ends_as_it_should[[]synthetic_and_real*]",
    "tests/examples/test_programs.py::test_a_program_runs_and_prints_what_it_promises[[]0[12789]*",
    "tests/examples/test_programs.py::test_a_program_runs_and_prints_what_it_promises[[]1[02]*",
    "tests/planning/test_paper_plans.py::test_the_papers_tree_passes_the_check_and_acquires_exactly*",
    "tests/robots/test_arms.py::test_a_second_arm_measures_the_same*",
    "tests/quantities/test_mass.py::test_mass_of_light_and_heavy_objects*",
    "tests/quantities/test_mass.py::test_residual_of_every_approach_does_not_reach_the_mass",
    "tests/quantities/test_size.py::test_a_crate_is_measured_from_a_sentence",
    "tests/quantities/test_friction.py::test_the_arms_own_friction_does_not_reach_the_estimate*",
    "tests/estimation/test_load.py::test_gains_are_carried_through_the_jacobian",
    "tests/vocabulary/test_turning.py::test_the_inertia_of_a_bar_is_swung_out_of_it",
    "tests/cli/test_models.py::test_from_a_sentence_a_picture_and_a_camera_to_complete_mjcf",
    "tests/cli/test_stored_runs.py::test_what_a_run_in_a_hurry_left_out_is_made_later",
    "tests/cli/test_teach.py::test_an_arm_is_examined_and_its_hand_shows_where_things_are",
    "tests/studies/test_accuracy.py::test_seeds_are_independent_runs_of_one_world",
    "tests/execution/test_repetition.py::test_repeated_run_is_complete",
    "tests/cli/test_models.py::test_a_value_that_is_not_believed_is_measured_again",
    "tests/cli/test_models.py::test_a_lean_prompt_and_a_critic_are_asked_for_on_the_command_line",
    "tests/execution/test_recovery.py::test_replanning_*",
)

MINUTES = (
    "tests/robots/franky/test_gauges.py::*",
    "tests/test_unknown_heights.py::*",
    "tests/studies/planners/test_ablation.py::*",
    "tests/studies/test_cluster.py::*",
    "tests/calibration/test_camera.py::test_a_tag_tells_where_the_camera_is[[]world:workspace*",
    "tests/studies/test_efficiency.py::test_one_missing_mass_takes_less_than_everything",
    "tests/cli/test_models.py::test_the_papers_tables_are_made_and_gone_on_with",
    "tests/cli/test_models.py::test_from_a_sentence_a_picture_and_a_camera_to_complete_mjcf",
    "tests/cli/test_models.py::test_the_answer_of_any_chat_is_checked_and_executed",
    "tests/cli/test_models.py::test_a_conversation_is_replayed_without_network",
    "tests/robots/franky/test_over_the_wire.py::test_an_obstacle_is_carried_aside_and_back",
    "tests/robots/franky/test_over_the_wire.py::test_a_door_is_moved_on_its_arc_and_left_where_it_was",
    "tests/robots/franky/test_command_line.py::test_from_rehearsal_to_report_with_a_person_who_lets_it_move",
    "tests/robots/franky/test_faults.py::test_after_a_user_stop_nothing_is_put_down_and_nobody_goes_on",
    "tests/robots/franky/test_faults.py::test_lost_cycles_end_nothing",
    "tests/scenarios/test_catalogue.py::test_a_scenario_ends_as_it_should[[]fifteen_objects]",
    "tests/scenarios/test_rehearsals.py::*",
    "tests/test_pipeline.py::test_every_stage_can_start_from_the_folder",
    "tests/execution/test_repetition.py::test_a_value_is_measured_until_it_is_as_narrow_as_asked*",
    "tests/examples/test_programs.py::test_a_program_runs_and_prints_what_it_promises[[]13_drawer]",
    "tests/examples/test_programs.py::test_a_program_runs_and_prints_what_it_promises[[]08*",
    "tests/cli/test_models.py::test_bottle_and_table_end_to_end_over_http",
    "tests/cli/test_models.py::test_a_value_that_is_not_believed_is_measured_again",
    "tests/cli/test_models.py::test_a_lean_prompt_and_a_critic_are_asked_for_on_the_command_line",
    "tests/runs/test_read.py::test_a_scene_that_was_seen_in_a_picture_is_the_one_that_contact_told",
    "tests/vocabulary/test_handle.py::test_a_drawer_is_measured_and_left_where_it_was",
    "tests/vocabulary/test_handle.py::test_a_limit_that_nobody_stated_is_met_slowly_and_said",
    "tests/execution/test_repetition.py::test_repeated_run_is_complete",
    "tests/execution/test_repetition.py::test_round_of_repetition_goes_from_home_and_back",
    "tests/execution/test_repetition.py::test_result_states_the_asked_width_and_the_outcome",
    "tests/execution/test_repetition.py::test_rounds_end_however_much_more_would_narrow_it[[]20.0-5]",
    "tests/cli/test_signals.py::test_while_the_arm_moves[[]two]",
    "tests/scenarios/test_recorded_plans.py::test_a_recorded_plan_acquires_exactly_what_is_missing[[]*-model]",
    "tests/scenarios/test_catalogue.py::test_a_scenario_ends_as_it_should[[]drawer/door]",
    "tests/studies/test_accuracy.py::test_seeds_are_independent_runs_of_one_world",
    "tests/examples/test_programs.py::test_a_program_runs_and_prints_what_it_promises[[]1[02]*",
    "tests/quantities/test_friction.py::test_the_arms_own_friction_does_not_reach_the_estimate*",
    "tests/robots/test_arms.py::test_a_second_arm_measures_the_same*",
    "tests/scenarios/test_catalogue.py::test_a_scenario_ends_as_it_should[[]clutter]",
    "tests/scenarios/test_catalogue.py::test_a_scenario_ends_as_it_should[[]from_picture]",
    "tests/scenarios/test_catalogue.py::test_a_scenario_ends_as_it_should[[]synthetic_and_real*]",
    "tests/live/test_page.py::test_a_run_is_watched_and_played_again",
    "tests/test_api.py::test_the_same_seed_gives_the_same_run",
)
"""Of these, the longest: `make test-ci` leaves them out, to stay under a quarter of an hour."""


def pytest_collection_modifyitems(items: Sequence[pytest.Item]) -> None:
    """Mark them."""
    for item in items:
        if any(fnmatch(item.nodeid, pattern) for pattern in MINUTES):
            item.add_marker("minutes")
        if any(fnmatch(item.nodeid, pattern) for pattern in (*LONG, *MINUTES)):
            item.add_marker("long")
