"""Triangle meshes: connectivity, areas, Laplacians and the solver for them."""

from modalmotion.arguments.checking import check_arguments
from modalmotion.mesh.areas import (
    face_areas,
    face_gradients,
    face_normals,
    mean_slopes,
    vertex_areas,
)
from modalmotion.mesh.cavity import Cavity, cavity_of
from modalmotion.mesh.connectivity import (
    Connectivity,
    connectivity_of,
    grouped_edges,
    oriented_faces,
)
from modalmotion.mesh.dissection import nested_dissection, solve_positive_definite
from modalmotion.mesh.laplacian import cotangent_laplacian, divergence, graph_laplacian
from modalmotion.mesh.lattice_triangles import lattice_faces

__all__ = [
    "Cavity",
    "Connectivity",
    "cavity_of",
    "connectivity_of",
    "cotangent_laplacian",
    "divergence",
    "face_areas",
    "face_gradients",
    "face_normals",
    "graph_laplacian",
    "grouped_edges",
    "lattice_faces",
    "mean_slopes",
    "nested_dissection",
    "oriented_faces",
    "solve_positive_definite",
    "vertex_areas",
]

check_arguments(globals())
