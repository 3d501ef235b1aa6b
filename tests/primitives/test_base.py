"""The base class, and the registry with third parties in it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest
from pydantic import ValidationError

from palpate.common import extensions as extensions_module
from palpate.common.errors import InputError
from palpate.common.extensions import extensions
from palpate.estimation.quantities.catalogue import catalogue
from palpate.primitives.base import ConversionPrimitive, Primitive
from palpate.primitives.motion import MovePose
from palpate.primitives.registry import load_vocabulary, vocabulary

THIRD_PARTY = '''
from dataclasses import replace
from typing import ClassVar
from palpate.estimation.quantities.quantity import Quantity
from palpate.primitives.motion import MovePose
from palpate.primitives.base import ConversionPrimitive, Primitive

class Odour(Quantity):
    id, unit, subject = "smell", "ou", "object"
    words = {"en": ("smell", "odour")}
    how = "Sniff"

class _Instrument(Primitive):
    """Not for plans."""
    group: ClassVar = "sensing"

class Sniff(_Instrument):
    """Smell at what is near."""
    seconds: float = 1.0

class Smell(ConversionPrimitive):
    """Say how it smells."""
    measures: ClassVar = Odour
'''


OWN = [
    "MovePose",
    "MoveJoints",
    "Tilt",
    "Turn",
    "Swing",
    "OpenGripper",
    "CloseGripper",
    "FoldFingers",
    "MoveUntilContact",
    "MoveHandle",
    "FindLimits",
    "MeasureForces",
    "MeasureGripperPose",
    "Force2Mass",
    "Force2Velocity",
    "Force2Momentum",
    "Pose2Height",
    "Pose2Plan",
]
"""The paper's twelve primitives, and six more."""


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], None]]:
    """Install a package with one entry point; it is gone after the test."""

    def install(source: str) -> None:
        info = tmp_path / "palpate_nose-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: palpate-nose\nVersion: 1.0\n")
        groups = ("palpate.primitives", "palpate.quantities")
        entries = "".join(f"[{group}]\nnose = palpate_nose\n" for group in groups)
        (info / "entry_points.txt").write_text(entries)
        (tmp_path / "palpate_nose.py").write_text(source)
        monkeypatch.syspath_prepend(tmp_path)
        monkeypatch.delitem(sys.modules, "palpate_nose", raising=False)
        vocabulary.cache_clear()
        catalogue.cache_clear()

    yield install
    vocabulary.cache_clear()
    catalogue.cache_clear()


def test_palpates_own_come_first_in_reading_order() -> None:
    assert list(vocabulary().primitives)[: len(OWN)] == OWN
    assert list(vocabulary().composites) == ["Sequence", "Parallel"]


def test_a_vocabulary_is_a_value(installed: Callable[[str], None]) -> None:
    alone = load_vocabulary()
    assert list(alone.primitives) == OWN
    assert repr(alone) == "<Vocabulary: 18 primitives, 2 composites>"
    installed(THIRD_PARTY)
    more = load_vocabulary(extensions("palpate.primitives"))
    assert list(more.primitives) == [*OWN, "Smell", "Sniff"]
    assert list(load_vocabulary().primitives) == OWN


def test_metadata_of_an_older_palpate_that_names_its_own_primitives_does_no_harm(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    old = EntryPoint("core", "palpate.vocabulary.core", "palpate.primitives")
    monkeypatch.setattr(extensions_module, "entry_points", lambda group: [old])
    assert list(load_vocabulary(extensions("palpate.primitives")).primitives) == OWN


def test_a_third_partys_primitives_are_found_and_its_quantity_with_them(
    installed: Callable[[str], None],
) -> None:
    installed(THIRD_PARTY)
    words = vocabulary()
    assert [name for name in words.primitives if name not in OWN] == ["Smell", "Sniff"]
    assert words.primitives["MovePose"] is MovePose
    assert catalogue()["smell"].unit == "ou"
    assert words.make("Sniff", {"seconds": 2.0}).label == "Sniff(2.0)"


def test_all_decides_which_primitives_are_public(installed: Callable[[str], None]) -> None:
    installed(THIRD_PARTY + '__all__ = ["Sniff"]\n')
    assert "Smell" not in vocabulary().primitives
    assert "Sniff" in vocabulary().primitives


def test_palpates_own_cannot_be_replaced(installed: Callable[[str], None]) -> None:
    installed(
        "from palpate.primitives.base import Primitive\nclass MovePose(Primitive):\n    '''Mine.'''\n"
    )
    assert vocabulary().primitives["MovePose"] is MovePose


@pytest.mark.parametrize(
    "source", ["import no_such_module", "raise RuntimeError('no licence')", "def"]
)
def test_a_package_that_does_not_load_is_named(
    installed: Callable[[str], None], source: str
) -> None:
    installed(source)
    with pytest.raises(InputError, match=r"'nose' \(palpate_nose\) cannot be loaded"):
        vocabulary()


def test_an_unknown_name_lists_the_valid_ones() -> None:
    with pytest.raises(InputError, match=r"unknown primitive 'WeighObject'.*Force2Mass.*Sequence"):
        vocabulary().make("WeighObject", {})


@pytest.mark.parametrize(
    ("kind", "arguments"),
    [
        ("OpenGripper", {"width": 0.02}),
        ("MovePose", {}),
        ("MovePose", {"pose": ""}),
        ("MovePose", {"pose": "x" * 201}),
        ("MovePose", {"pose": 3}),
        ("MoveJoints", {"joints": [0, float("nan")]}),
        ("MoveUntilContact", {"axis": "z"}),
    ],
)
def test_arguments_that_do_not_fit_are_refused(kind: str, arguments: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        vocabulary().make(kind, arguments)


@pytest.mark.parametrize("cls", vocabulary().primitives.values(), ids=lambda cls: cls.__name__)
def test_every_primitive_says_what_it_does_and_who_it_is(cls: type[Primitive]) -> None:
    assert len(cls.summary()) > 40
    assert cls.group in ("motion", "gripper", "sensing", "conversion")
    assert all(field.description for field in cls.model_fields.values())
    assert issubclass(cls, ConversionPrimitive) == (cls.measures is not None)
    if cls.measures is not None:
        assert type(catalogue()[cls.measures.id]) is cls.measures


def test_label_of_a_primitive_shows_its_arguments() -> None:
    assert (
        vocabulary().make("MovePose", {"pose": "cup_pose + z_offset"}).label
        == "MovePose(cup_pose + z_offset)"
    )
    assert vocabulary().make("OpenGripper", {}).label == "OpenGripper()"
