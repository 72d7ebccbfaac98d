"""Options that state facts of a sequence, shared by all commands that read FILE."""

from __future__ import annotations

from typing import Any, Final

import click

from modalmotion.cli.options import FACTS, Grouped, options_of, several
from modalmotion.mesh import WORDS, Facts, facts_from_texts
from modalmotion.mesh.facts import stated_twice

_MANY: Final = {
    "landmark": (
        "NAME=PLACE",
        "A vertex's number or a point x,y,z, such as apex=17; repeat for more.",
    ),
    "covariate": ("NAME=VALUE", "A number or a word, such as age=61; repeat for more."),
}
_UNSTATED: Final = {"default": None}

FACT_OPTIONS: Final = (*WORDS, "period", "modality", *_MANY)
"""Names of these options."""

fact_options = several(
    options_of(Facts, *WORDS, "period", "modality", group=FACTS, **dict.fromkeys(WORDS, _UNSTATED)),
    *(
        click.option(
            f"--{name}", cls=Grouped, group=FACTS, metavar=metavar, multiple=True, help=text
        )
        for name, (metavar, text) in _MANY.items()
    ),
)
"""Facts, which override the file's own; `stated_facts` reads them."""


def stated_facts(options: dict[str, Any]) -> Facts:
    """Take the options that state facts out of all options.

    Raises
    ------
    ParameterError
        If one is out of range, or something is stated twice.
    """
    texts: dict[str, Any] = {name: options.pop(name, None) for name in FACT_OPTIONS}
    for kind in _MANY:
        for pair in texts.pop(kind) or ():
            name, equals, value = pair.partition("=")
            if not equals or not value.strip():
                raise click.BadParameter(
                    f"{pair[:60]!r} has no value; write it as NAME=VALUE.", param_hint=f"--{kind}"
                )
            key = f"{kind}:{name.strip()}"
            if key in texts:
                raise stated_twice(kind, name.strip(), name.strip())
            texts[key] = value
    return facts_from_texts(texts)
