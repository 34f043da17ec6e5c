"""The optimisers side by side, on the bundled photo: the loss after the same number of seconds, and in the end.

python -m teg.examples.triangulation.optimisers
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence

from teg.examples.photo import read_target
from teg.examples.triangulation.baselines import psnr
from teg.examples.triangulation.colour_fit import TERMS
from teg.examples.triangulation.descent import OPTIMISERS, first_state, next_state
from teg.examples.triangulation.image_loss import ImageLoss
from teg.examples.triangulation.mesh import make_mesh
from teg.examples.triangulation.refinement import refine
from teg.examples.triangulation.scene import compile_scene

SIZE, TRIANGLES = 256, 300
SECONDS = (1, 3, 10)
REFINE = 15


def descend(optimiser: str, degree: int, every: int = 0, seconds: Sequence[float] = SECONDS) -> list[float]:
    """Returns the best loss so far after so many seconds of descent; `every` so many steps comes a refinement."""
    mesh = make_mesh(TRIANGLES, SIZE)
    image = ImageLoss(compile_scene("c", threads=os.cpu_count() or 1, degree=degree), read_target(None, SIZE), mesh.triangles)
    state = first_state(mesh, image, TERMS[degree])
    image.gradient(state.vertices, state.colours)  # compiled now
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
    print(f"{TRIANGLES} triangles, {SIZE}² pixels, losses after " + ", ".join(f"{s} s" for s in SECONDS))
    for degree, name in enumerate(("constant", "linear")):
        for optimiser in OPTIMISERS:
            for every in (0, REFINE) if optimiser != "gradient" else (0,):
                losses = descend(optimiser, degree, every if optimiser != "lbfgs" else every // 5)
                numbers = " ".join(f"{loss:.5f}" for loss in losses)
                print(f"{name:<9} {optimiser:<10} refine {every:<3} {numbers}   {psnr(losses[-1]):.2f} dB", flush=True)


if __name__ == "__main__":
    main()
