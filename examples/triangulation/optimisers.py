"""The optimisers side by side, on the bundled photo: the loss after the same number of seconds, and in the end.

python -m teg.examples.triangulation.optimisers [--size 128 --triangles 150 --seconds 1 3]
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Sequence

import numpy as np

from teg.examples.photo import read_target
from teg.examples.triangulation.baselines import psnr
from teg.examples.triangulation.colour_fit import TERMS
from teg.examples.triangulation.descent import OPTIMISERS, first_state, next_state
from teg.examples.triangulation.image_loss import ImageLoss
from teg.examples.triangulation.mesh import make_mesh
from teg.examples.triangulation.refinement import refine
from teg.examples.triangulation.scene import compile_scene

REFINE = 15
OFTENER = {"lbfgs": 5, "newton": 3}  # of what does much in one step


def descend(optimiser: str, degree: int, every: int, shape: tuple[int, int], seconds: Sequence[float]) -> list[float]:
    """Returns the best loss so far after so many seconds of descent; `every` so many steps comes a refinement.

    `shape` is the number of triangles and of pixels a side.
    """
    mesh = make_mesh(*shape)
    image = ImageLoss(compile_scene("c", threads=os.cpu_count() or 1, degree=degree), read_target(None, shape[1]), mesh.triangles)
    state = first_state(mesh, image, TERMS[degree])
    image.gradient(state.vertices, state.colours)  # compiled now
    if optimiser == "newton":
        image.hessian_product(state.vertices, state.colours, np.ones(state.vertices.shape))
    best, losses, begun = state.loss, [], time.perf_counter()
    for limit in seconds:
        while time.perf_counter() - begun < limit and not state.stuck:
            state = next_state(image, state, mesh.size, optimiser)
            if every and not state.stuck and state.step % every == 0:
                state = refine(image, state, mesh.size)
            best = min(best, state.loss)
        losses.append(best)
    return losses


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description="Prints the losses of the optimisers after some seconds of descent.")
    parser.add_argument("--triangles", type=int, default=300)
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--seconds", type=float, nargs="+", default=(1.0, 3.0, 10.0))
    chosen = parser.parse_args()
    print(f"{chosen.triangles} triangles, {chosen.size}² pixels, losses after " + ", ".join(f"{s:g} s" for s in chosen.seconds))
    for degree, name in enumerate(("constant", "linear")):
        for optimiser in OPTIMISERS:
            for every in (0, REFINE) if optimiser != "gradient" else (0,):
                losses = descend(optimiser, degree, every // OFTENER.get(optimiser, 1), (chosen.triangles, chosen.size), chosen.seconds)
                numbers = " ".join(f"{loss:.5f}" for loss in losses)
                print(f"{name:<9} {optimiser:<10} refine {every:<3} {numbers}   {psnr(losses[-1]):.2f} dB", flush=True)


if __name__ == "__main__":
    main()
