"""HTML pages from the Jinja2 templates in web/templates/: one head, one style, all text escaped."""

from __future__ import annotations

import base64
import re
from functools import lru_cache
from pathlib import Path
from typing import Any, Mapping, Optional

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from husky_highlevel_controller.config import to_json
from husky_highlevel_controller.paths import share_folder
from husky_highlevel_controller.result import Result

_OPTION = re.compile(r"(?<![\w&#;-])--?\w[\w-]*")  # pattern of a command-line option, such as --name


def render(template: str, **values: Any) -> str:
    """Return the HTML page of a template in web/templates/; the page needs no other file."""
    return _environment().get_template(template).render(**values)


def write_page(result: Result, folder: Path, pictures: Optional[Mapping[str, bytes]] = None) -> Path:
    """Write a result as a page, index.html, and as data, report.json; return the path of the page.

    Args:
        result: the result.
        folder: folder that gets both files.
        pictures: PNGs of the page by their captions.
    """
    (folder / "report.json").write_text(to_json(result), encoding="utf-8")
    page = folder / "index.html"
    page.write_text(render("report.html", result=result, pictures=pictures or {}), encoding="utf-8")
    return page


def unbroken_options(text: str) -> Markup:
    """Return a text as HTML, in which a browser does not break a line inside an option such as --name."""
    return Markup(_OPTION.sub(r'<span class="unbroken">\g<0></span>', str(escape(text))))


@lru_cache(maxsize=1)
def _environment() -> Environment:
    """Return Jinja's environment for all templates, with the style and functions that the templates use.

    The environment is made once, because it keeps the compiled templates.
    """
    folder = share_folder() / "web" / "templates"
    environment = Environment(
        loader=FileSystemLoader(str(folder)),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["unbroken"] = unbroken_options
    environment.globals.update(
        style=Markup((folder / "style.css").read_text(encoding="utf-8")),
        script=lambda name: Markup((folder / name).read_text(encoding="utf-8")),
        number=lambda value: f"{value:.4g}" if isinstance(value, float) else str(value),
        image=lambda png: f"data:image/png;base64,{base64.b64encode(png).decode()}",
    )
    return environment
