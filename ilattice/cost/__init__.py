"""Corner-sharing tetrahedra."""
