"""A small layered dome and a small block to be meshed in seconds."""

from gelforge.mechanics.meshes.mesh import Block, Sizes
from gelforge.meshing.solids import block_solids, dome_solids

# name: (solids, the point that is touched)
SHAPES = {
    "dome": (dome_solids(12.0, 10.0, (("gel", 4.0), ("skin", 1.0))), [6.0, 5.0, 0.0, 0.0]),
    "block": (block_solids(Block(10.0, 8.0, (("gel", 2.5), ("skin", 1.0)), wall=1.0)), [5.0, 4.0, 0.0, 0.0]),
}
SIZES = Sizes(near=0.3, near_radius=1.5, growth=0.4, far=1.0)
