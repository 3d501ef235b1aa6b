"""What palpate uses of plotly's page writer."""

from collections.abc import Mapping

def to_html(
    fig: Mapping[str, object],
    config: Mapping[str, object] | None = None,
    *,
    include_plotlyjs: bool = True,
    full_html: bool = True,
    div_id: str | None = None,
) -> str: ...
