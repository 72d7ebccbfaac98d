"""Templates: natural coordinates, weights, lengths and landmarks of a surface."""

from typing import TYPE_CHECKING

from modalmotion.arguments.public import public_list

if TYPE_CHECKING:
    from modalmotion.template.construction import make_template as make_template
    from modalmotion.template.landmarks import GivenLandmarks as GivenLandmarks
    from modalmotion.template.landmarks import Landmarks as Landmarks
    from modalmotion.template.template import Template as Template
    from modalmotion.template.template import choose_modes as choose_modes
    from modalmotion.template.template import require_same_mesh as require_same_mesh
    from modalmotion.template.template import template_id as template_id

__all__, __getattr__, __dir__ = public_list(globals())
