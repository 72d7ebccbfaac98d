"""Options that state facts of a sequence, shared by all commands that read FILE."""

from __future__ import annotations

from typing import Any, Final

import click

from modalmotion.cli.options import reading_option, several
from modalmotion.facts import WORDS, Facts, facts_from_texts
from modalmotion.facts.facts import stated_twice

_HELP: Final = {
    "tracking": "Whether vertices follow tissue (material) or slide over it (offset).",
    "handedness": "Handedness of the coordinate system.",
    "coordinates": "Which way x, y and z point in a patient.",
    "cavity": "What the surface encloses.",
}

_MANY: Final = ("landmark", "covariate")


fact_options = several(
    *(
        reading_option(
            f"--{name}", type=click.Choice(words, case_sensitive=False), help=_HELP[name]
        )
        for name, words in WORDS.items()
    ),
    reading_option("--period", type=float, help="Period of a cycle, in seconds."),
    reading_option("--modality", help="How it was recorded: MR, CT, US, simulated."),
    reading_option(
        "--landmark",
        metavar="NAME=PLACE",
        multiple=True,
        help="A vertex's number or a point x,y,z; repeat for more. apex, base and theta_zero "
        "place the natural coordinates.",
    ),
    reading_option(
        "--covariate",
        metavar="NAME=VALUE",
        multiple=True,
        help="A number or a word, such as age=61; repeat for more.",
    ),
)
"""Facts, which override the file's own; `stated_facts` reads them."""

FACT_OPTIONS: Final = (*WORDS, "period", "modality", *_MANY)
"""Names of these options."""


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
