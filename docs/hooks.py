"""Pages that are made of the declarations when the site is built: the command line, and the schema of
poses.yaml."""

from __future__ import annotations

import json
from importlib import reload
from typing import Any

import typer
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from pydantic import BaseModel
from typer.cli import get_docs_for_click

from palpate.cli.app import app
from palpate.scene import poses


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """The site's files, and those that are generated."""
    files.append(File.generated(config, "commands.md", content=_commands()))
    files.append(File.generated(config, "poses.schema.json", content=_poses_schema()))
    return files


def on_post_page(output: str, **_: Any) -> str:
    """A page that would fetch something from elsewhere is an error of the build."""
    for needle in ('src="http', 'rel="stylesheet" href="http'):
        if needle in output:
            raise ValueError(f"a page fetches something from elsewhere: {needle}…")
    return output


def _commands() -> str:
    command = typer.main.get_command(app)
    context = typer.Context(command, info_name="palpate")
    return get_docs_for_click(obj=command, ctx=context, name="palpate", title="The command line")


def _poses_schema() -> str:
    # The docstrings of attributes are read from the source, which is too slow for the start of a command.
    BaseModel.model_config["use_attribute_docstrings"] = True
    return json.dumps(reload(poses).Poses.model_json_schema(), indent=2) + "\n"
