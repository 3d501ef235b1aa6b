"""Pages that are generated from the code when the site is built: the command line, the vocabulary of
plans, the keys of YAML files, and the schema of poses.yaml."""

from __future__ import annotations

import json
import runpy
from collections.abc import Callable, Iterator
from importlib import reload
from pathlib import Path
from typing import Any

import typer
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from pydantic import BaseModel
from typer.cli import get_docs_for_click

from palpate.cli.app import app
from palpate.primitives.registry import vocabulary
from palpate.scene import poses

RESULTS = Path(__file__).parents[1] / "bench" / "RESULTS.md"


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages to the site's files."""
    files.append(File.generated(config, "commands.md", content=_commands()))
    files.append(
        File.generated(config, "vocabulary.md", content=_page("vocabulary_page")(vocabulary()))
    )
    files.append(File.generated(config, "keys.md", content=_page("keys_page")()))
    files.append(File.generated(config, "results.md", content=RESULTS.read_text(encoding="utf-8")))
    files.append(File.generated(config, "poses.schema.json", content=_poses_schema()))
    return files


def on_post_page(output: str, **_: Any) -> str:
    """Reject a page that would fetch a file from another host."""
    for needle in ('src="http', 'rel="stylesheet" href="http'):
        if needle in output:
            raise ValueError(f"a page fetches something from elsewhere: {needle}…")
    return output


def _commands() -> str:
    command = typer.main.get_command(app)
    context = typer.Context(command, info_name="palpate")
    text = get_docs_for_click(obj=command, ctx=context, name="palpate", title="The command line")
    # Typer cuts the summaries in the lists of commands at 45 characters.
    for inner in _inner_commands(command):
        text = text.replace(inner.get_short_help_str(), inner.get_short_help_str(limit=200))
    return text


def _inner_commands(command: Any) -> Iterator[Any]:
    for inner in getattr(command, "commands", {}).values():
        yield inner
        yield from _inner_commands(inner)


def _page(name: str) -> Callable[..., str]:
    return runpy.run_path(str(Path(__file__).with_name(f"{name}.py")))["page"]


def _poses_schema() -> str:
    # Pydantic parses the source to read the docstrings of attributes, too slow for the start of a command.
    BaseModel.model_config["use_attribute_docstrings"] = True
    return json.dumps(reload(poses).Poses.model_json_schema(), indent=2) + "\n"
