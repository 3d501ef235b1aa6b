import io
from pathlib import Path

import pytest
from PIL import Image

from palpate.errors import InputError
from palpate.planning.model.picture import LONGEST_SIDE, picture


def saved(path: Path, size: tuple[int, int], mode: str = "RGB") -> Path:
    Image.new(mode, size).save(path)
    return path


def test_a_large_picture_is_downscaled_to_the_stated_size(tmp_path: Path) -> None:
    sent = picture(saved(tmp_path / "a.png", (4000, 1000)))
    assert (sent.width, sent.height) == (LONGEST_SIDE, LONGEST_SIDE // 4)
    assert Image.open(io.BytesIO(sent.data)).size == (sent.width, sent.height)


def test_a_small_one_is_not_enlarged_and_loses_its_alpha(tmp_path: Path) -> None:
    sent = picture(saved(tmp_path / "a.png", (64, 48), "RGBA"))
    assert (sent.width, sent.height, sent.media_type) == (64, 48, "image/jpeg")


@pytest.mark.parametrize(
    "content", [b"", b"no picture", b"GIF89a" + bytes(100), b"\x89PNG\r\n\x1a\n" + bytes(50)]
)
def test_what_is_no_picture_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.png").write_bytes(content)
    with pytest.raises(InputError, match=r"a\.png"):
        picture(tmp_path / "a.png")


def test_a_missing_file_and_a_bomb_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        picture(tmp_path / "none.png")
    with pytest.raises(InputError, match="bomb"):
        picture(saved(tmp_path / "bomb.png", (12_000, 12_000), "1"))
