"""Meshes that move: sequences, facts, connectivity, areas, Laplacians and alignment."""

from typing import TYPE_CHECKING

from modalmotion.arguments.public import public_list

if TYPE_CHECKING:
    from modalmotion.mesh.fact_forms import column_of as column_of
    from modalmotion.mesh.fact_forms import facts_as_json as facts_as_json
    from modalmotion.mesh.fact_forms import facts_from_json as facts_from_json
    from modalmotion.mesh.fact_forms import facts_from_texts as facts_from_texts
    from modalmotion.mesh.fact_forms import facts_in as facts_in
    from modalmotion.mesh.fact_forms import facts_patched as facts_patched
    from modalmotion.mesh.fact_forms import is_fact as is_fact
    from modalmotion.mesh.fact_forms import states_fact as states_fact
    from modalmotion.mesh.facts import NAMES as NAMES
    from modalmotion.mesh.facts import NO_FACTS as NO_FACTS
    from modalmotion.mesh.facts import UNKNOWN as UNKNOWN
    from modalmotion.mesh.facts import WORDS as WORDS
    from modalmotion.mesh.facts import Corners as Corners
    from modalmotion.mesh.facts import Facts as Facts
    from modalmotion.mesh.facts import Place as Place
    from modalmotion.mesh.geometry import Cavity as Cavity
    from modalmotion.mesh.geometry import cavity_of as cavity_of
    from modalmotion.mesh.laplacian import cotangent_laplacian as cotangent_laplacian
    from modalmotion.mesh.laplacian import graph_laplacian as graph_laplacian
    from modalmotion.mesh.laplacian import solve_positive_definite as solve_positive_definite
    from modalmotion.mesh.sequence import lattice_faces as lattice_faces
    from modalmotion.mesh.triangles import Connectivity as Connectivity
    from modalmotion.mesh.triangles import connectivity_of as connectivity_of
    from modalmotion.mesh.triangles import face_areas as face_areas
    from modalmotion.mesh.triangles import face_gradients as face_gradients
    from modalmotion.mesh.triangles import face_normals as face_normals
    from modalmotion.mesh.triangles import grouped_edges as grouped_edges
    from modalmotion.mesh.triangles import mean_slopes as mean_slopes
    from modalmotion.mesh.triangles import oriented_faces as oriented_faces
    from modalmotion.mesh.triangles import vertex_areas as vertex_areas

__all__, __getattr__, __dir__ = public_list(globals())
