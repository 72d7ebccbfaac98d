"""Our profile of FHIR R4 bundles as a JSON schema: what is there, and nothing else."""

from __future__ import annotations

from typing import Any

UUID = "^urn:uuid:[0-9a-f-]{36}$"
ID = "^[0-9a-f-]{36}$"
INSTANT = r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(Z|[+-]\d\d:\d\d)$"


def thing(required: dict[str, Any], **optional: Any) -> dict[str, Any]:
    """An object that has all of these, perhaps those, and nothing else."""
    return {
        "type": "object",
        "properties": {**required, **optional},
        "required": list(required),
        "additionalProperties": False,
    }


def some(of: dict[str, Any]) -> dict[str, Any]:
    return {"type": "array", "items": of, "minItems": 1}


TEXT = {"type": "string", "pattern": r"\S"}
CODING = thing(
    {"system": {"type": "string", "pattern": "^(urn:|http://)"}, "code": TEXT}, display=TEXT
)
CONCEPT = {
    "type": "object",
    "properties": {"coding": some(CODING), "text": TEXT},
    "additionalProperties": False,
    "minProperties": 1,
}
QUANTITY = thing(
    {
        "value": {"type": "number"},
        "unit": TEXT,
        "system": {"const": "http://unitsofmeasure.org"},
        "code": {"enum": ["%", "mL", "mm", "cm", "m", "um", "nm", "ms", "1"]},
    }
)
SAMPLED = thing(
    {
        "origin": QUANTITY,
        "period": {"type": "number", "exclusiveMinimum": 0},
        "dimensions": {"type": "integer", "minimum": 1},
        "data": {"type": "string", "pattern": r"^-?\d+(\.\d+)?( -?\d+(\.\d+)?)*$"},
    }
)
NARRATIVE = thing(
    {
        "status": {"const": "generated"},
        "div": {
            "type": "string",
            "pattern": '^<div xmlns="http://www.w3.org/1999/xhtml">.+</div>$',
        },
    }
)
REFERENCE = thing({"reference": {"type": "string", "pattern": UUID}}, type=TEXT)
IDENTIFIER = thing({"system": TEXT, "value": TEXT})
# Why an element has no value, and nothing else: no name and no date.
UNNAMED = thing(
    {
        "extension": some(
            thing(
                {
                    "url": {"pattern": "/data-absent-reason$"},
                    "valueCode": {"enum": ["unknown", "not-applicable"]},
                }
            )
        )
    },
    display={"enum": ["Not stated", "No person: computed by the device"]},
)
ABSENT = {"dataAbsentReason": CONCEPT}
PART = {
    "oneOf": [
        thing({"code": CONCEPT, "valueQuantity": QUANTITY}),
        thing({"code": CONCEPT, **ABSENT}),
    ]
}


def resource(kind: str, required: dict[str, Any], **optional: Any) -> dict[str, Any]:
    head = {"resourceType": {"const": kind}, "id": {"type": "string", "pattern": ID}}
    return thing({**head, "text": NARRATIVE, **required}, **optional)


STATUS = {"const": "preliminary"}
TIME = {"type": "string", "pattern": INSTANT}

OBSERVATION = {
    **resource(
        "Observation",
        {
            "status": STATUS,
            "category": some(CONCEPT),
            "code": CONCEPT,
            "subject": {**UNNAMED, "required": ["extension", "display"]},
            "_effectiveDateTime": UNNAMED,
            "issued": TIME,
            "performer": some(UNNAMED),
        },
        device=REFERENCE,
        method=CONCEPT,
        note=some(thing({"text": TEXT})),
        component=some(PART),
        valueQuantity=QUANTITY,
        valueSampledData=SAMPLED,
        valueCodeableConcept=CONCEPT,
        **ABSENT,
    ),
    # obs-6: a reason for absence and a value exclude one another; something is there.
    "oneOf": [
        {"required": [name]}
        for name in (
            "valueQuantity",
            "valueSampledData",
            "valueCodeableConcept",
            "dataAbsentReason",
        )
    ]
    + [
        {
            "required": ["component"],
            "not": {
                "anyOf": [
                    {"required": [name]}
                    for name in (
                        *("valueQuantity", "valueSampledData"),
                        *("valueCodeableConcept", "dataAbsentReason"),
                    )
                ]
            },
        }
    ],
}

RESOURCES = [
    resource(
        "DiagnosticReport",
        {
            "identifier": some(IDENTIFIER),
            "status": STATUS,
            "code": CONCEPT,
            "issued": TIME,
            "result": some(REFERENCE),
            "conclusion": TEXT,
        },
    ),
    OBSERVATION,
    resource(
        "Device",
        {
            "status": {"const": "active"},
            "deviceName": some(thing({"name": TEXT, "type": {"const": "model-name"}})),
            "version": some(thing({"value": TEXT})),
            "note": some(thing({"text": TEXT})),
        },
    ),
    resource(
        "Provenance",
        {
            "target": some(REFERENCE),
            "recorded": TIME,
            "agent": some(thing({"who": REFERENCE})),
            "entity": some(
                thing({"role": {"const": "source"}, "what": thing({"identifier": IDENTIFIER})})
            ),
        },
    ),
]

PROFILE = thing(
    {
        "resourceType": {"const": "Bundle"},
        "id": {"type": "string", "pattern": ID},
        "type": {"const": "collection"},
        "timestamp": TIME,
        "entry": some(
            thing(
                {
                    "fullUrl": {"type": "string", "pattern": UUID},
                    "resource": {"oneOf": RESOURCES},
                }
            )
        ),
    }
)
