"""Rows of the table of truth: the service."""

from __future__ import annotations

import json
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import chain

import numpy as np
from experiments import Row, quick, timed
from measure import medians, of_usual_core
from served import answers, large_beat, start
from started import beside_imports

from modalmotion import SignatureParameters, make_template, modal_signature
from modalmotion_service.commands.openapi import document

METHODS, OF_BARE = {"get", "post", "put", "patch", "delete"}, "of the rate of a bare upload"


@timed(
    Row("service.signature.share", f"signature, {OF_BARE}", "%", goal=45, better="higher"),
    # By so much one day differs from another, and a machine with other work from an idle one.
    Row("service.signature.processor", "signature over HTTP, processor time", "ms", tolerance=1.5),
    Row("service.signature.library", "of it, the library's", "", 0.65, "higher", tolerance=0.035),
    Row("service.class.share", f"class, {OF_BARE}", "%", better="higher"),
    Row("service.class.processor", "class over HTTP, processor time", "ms"),
    Row("service.stored.share", f"GET of a stored signature, {OF_BARE}", "%", better="higher"),
    Row("service.stored.processor", "GET of a stored signature, processor time", "ms", goal=2.5),
)
def over_http(_: int) -> tuple[float, ...]:
    (share, milliseconds), *others = answers(n_rounds=5, seconds=0.5).tolist()
    # Both cores are at it, as in the service.
    with ProcessPoolExecutor(2) as pool:
        library = 1e3 * of_usual_core(float(np.mean([*pool.map(fit_seconds, range(2))])))
    return (share, milliseconds, library / milliseconds, *chain.from_iterable(others))


def fit_seconds(_: int) -> float:
    """Processor time of one fit of the beat that is sent."""
    template = make_template(beat := large_beat())
    known = SignatureParameters(template=template.id)
    return medians({"": partial(modal_signature, beat, known, template=template)}, 9)[0]


@timed(
    Row("service.start.processor", "processor time until it is ready", "s", goal=1, tolerance=0.2),
    Row("service.start.processes", "processes at rest", goal=6, tolerance=0),
    Row("service.start.memory", "memory at rest, of all", "MB", goal=130, tolerance=4),
)
def at_rest(_: int) -> tuple[float, ...]:
    rest: list[float] = []

    def ready(environment: dict[str, str]) -> float:
        seconds, *rest[:] = start(environment)
        return seconds

    return *beside_imports(ready, n_rounds=3), *rest


@quick(
    Row("service.openapi.size", "openapi.json", "kB", goal=350, tolerance=5),
    Row("service.openapi.operations", "operations of the interface", goal=58, tolerance=0),
    Row("service.openapi.parameters", "parameters of all operations", goal=250, tolerance=0),
)
def interface(_: int) -> tuple[float, ...]:
    text = document()
    paths = json.loads(text)["paths"].values()
    calls = [call for path in paths for method, call in path.items() if method in METHODS]
    return len(text) / 1e3, len(calls), sum(len(call.get("parameters", ())) for call in calls)
