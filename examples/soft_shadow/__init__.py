"""The shadow of a mesh under a polygonal light, and the place of the mesh from its shadow."""
