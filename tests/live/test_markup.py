from palpate.live.markup import Line, outline


def test_names_of_nodes_are_no_markup() -> None:
    html = outline([Line("<script>alert(1)</script>", 1, "RUNNING", "\x1b[31mred")])
    assert "<script>" not in html
    assert "&lt;script&gt;" in html
    assert "\x1b" not in html
