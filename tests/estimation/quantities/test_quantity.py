"""The catalogue, and the thread through the program."""

from __future__ import annotations

import pytest

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.estimation.quantities.catalogue import catalogue


def test_ids_are_the_contract_with_scripts() -> None:
    assert list(catalogue())[:9] == [
        "mass",
        "height",
        "friction",
        "com",
        "com_3d",
        "inertia",
        "position",
        "velocity",
        "momentum",
    ]
    assert all(name == q.id for name, q in catalogue().items())


@pytest.mark.parametrize("entry", catalogue().values(), ids=lambda q: q.id)
def test_every_entry_is_complete(entry) -> None:
    assert entry.subject in ("object", "surface", "fixture", "gripper")
    assert entry.size >= 1
    assert entry.unit
    assert entry.how
    assert all(word == word.lower() for word in entry.words["en"])


def test_a_word_means_one_quantity() -> None:
    words = [word for q in catalogue().values() for word in q.words["en"]]
    assert sorted(set(words)) == sorted(words)


def test_every_quantity_can_be_measured() -> None:
    assert all(q.identifiable and q.evidence for q in catalogue().values())


def test_an_unknown_quantity_lists_the_valid_ones() -> None:
    assert catalogue().named("mass").unit == "kg"
    with pytest.raises(
        InputError,
        match=r"unknown quantity 'weight'; did you mean 'mass'\? valid: com, com_3d, contact_damping, damping, fr",
    ):
        catalogue().named("weight")


def test_parameters_are_values() -> None:
    assert str(Parameter("bottle", "mass")) == "bottle.mass"
    assert Parameter("bottle", "mass") == Parameter("bottle", "mass")
    assert sorted([Parameter("b", "mass"), Parameter("a", "mass"), Parameter("a", "com")]) == [
        Parameter("a", "com"),
        Parameter("a", "mass"),
        Parameter("b", "mass"),
    ]
    assert len({Parameter("a", "mass"), Parameter("a", "mass")}) == 1
