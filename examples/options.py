"""The options of all demonstrations: one table of names, kinds, limits and help, and one of the demonstrations with their defaults."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

from teg.errors import InputError
from teg.evaluator.options import Backend

BACKENDS = ("numpy", "c", "jax")


@dataclass(frozen=True)
class Option:
    """An option of a command line: the kind of its value, its help, and the values that are possible. A switch has the kind bool."""

    kind: type
    help: str
    metavar: str = ""
    least: float | None = None
    most: float | None = None
    choices: tuple[str, ...] = ()

    def check(self, name: str, value: Any) -> None:
        """Raises InputError for a value of another kind, or beyond the limits."""
        flag = "--" + name.replace("_", "-")
        if value is None:
            return
        fits = isinstance(value, (int, float) if self.kind is float else self.kind)
        if not fits or (isinstance(value, bool) and self.kind is not bool):
            raise InputError(f"{flag} is {value!r}", None, f"of the kind {self.kind.__name__}")
        if self.choices and value not in self.choices:
            raise InputError(f"{flag} is {value!r}", None, "one of " + ", ".join(self.choices))
        if self.kind is float and not math.isfinite(value):
            raise InputError(f"{flag} is {value}", None, "a finite number")
        least, most = (-math.inf if self.least is None else self.least), (math.inf if self.most is None else self.most)
        if self.kind in (int, float) and not least <= value <= most:
            limits = [f"at least {least:g}", *([f"at most {most:g}"] if most < math.inf else [])]
            raise InputError(f"{flag} is {value}", None, " and ".join(limits))


OPTIONS = {
    "triangles": Option(int, "about how many", "N", 2, 10**6),
    "size": Option(int, "pixels of the longer side", "S", 8, 4096),
    "steps": Option(int, "of the descent, in all", "K", 0, 10**7),
    "seed": Option(int, "of what is random at the start", "N", 0),
    "colours": Option(str, "of a triangle, as polynomials of the place", choices=("constant", "linear", "quadratic")),
    "optimiser": Option(str, "how the vertices descend", choices=("resilient", "adam", "gradient", "lbfgs", "newton")),
    "refine": Option(int, "split, join and flip triangles after every so many steps, such as 15; 0: never", "N", 0, 1000),
    "smoothness": Option(float, "weight of a penalty on long edges, beside the loss; such as 0.001", "W", 0, 1e6),
    "keep_area": Option(float, "weight of a penalty on triangles of little area; such as 0.0001", "W", 0, 1e6),
    "mesh": Option(str, "start from this mesh, as in mesh.ply of an earlier run, or an OBJ file", "FILE.ply"),
    "pin": Option(str, "vertices that stay, beside those that the mesh lists as pinned", choices=("border",)),
    "keep_colours": Option(bool, "the colours of the mesh that was read stay; only vertices move"),
    "shared_by": Option(str, "in JAX, on all its devices: what each has a part of", choices=("pairs", "faces")),
    "cells": Option(int, "cells a side, of the coarsest lattice or of the mesh", "N", 1, 1024),
    "octaves": Option(int, "each with twice the cells of the one before", "N", 1, 10),
    "noise": Option(str, "how it is interpolated between the nodes of a lattice", choices=("smoothstep", "quintic", "linear")),
    "node": Option(int, "lattice node by whose gradient the picture's derivative is drawn (one amid the picture)", "N", 0),
    "levels": Option(int, "colours, one more than thresholds", "N", 2, 3),
    "colour_cells": Option(int, "cells a side of a map of each colour; 0: one shade of it everywhere", "N", 0, 256),
    "epochs": Option(int, "of the training, in all", "K", 0, 10**7),
    "contacts": Option(int, "with floor and ceiling, by turns", "N", 1, 12),
    "speed": Option(float, "of the lift, upwards, in m/s", "V", -1e12, 1e12),
    "duration": Option(float, "of the flight, in s", "T"),
    "floor": Option(str, "a formula of x and t, in m and s, for an uneven floor instead of the lift: '0.1*sin(3*x) + 0.3*t'", "F"),
    "restitution": Option(float, "speed away from floor or ceiling after a contact, as a part of that towards it", "E", 0.1, 1),
    "scene": Option(str, "which balls, and where", choices=("exchange", "collision", "cushions", "break", "stack")),
    "balls": Option(str, "a scene of your own instead, in JSON (examples/billiards/README.md)", "FILE.json"),
    "apex": Option(float, "way to the lowest point of the fall, in m", "H", 0.1, 1000),
    "mass": Option(float, "of the jumper, in kg", "M", 0.1, 1000),
    "weight": Option(float, "of the squared acceleration at the lowest point, beside that of the time", "W", 0, 1000),
    "bidders": Option(int, "of the largest auction, beside those of one and two", "N", 1, 12),
    "rise": Option(float, "A of the values' distribution 1 - (1 - vᴬ)ᴮ between 0 and 1: how many are low", "A", 1, 50),
    "fall": Option(float, "B of it: how few are high", "B", 1, 50),
    "values": Option(str, "numbers in a text file; A, B and the highest value are fitted to them", "FILE"),
    "spot": Option(float, "price of the stock", "S", 1e-6, 1e9),
    "strike": Option(float, "price above which an option pays", "K", 1e-6, 1e9),
    "barrier": Option(float, "price at which the barrier option ends; below the stock's, at most the strike", "H", 1e-6, 1e9),
    "volatility": Option(float, "of the stock, a year's; 0.25 are 25 %", "V", 0.01, 5),
    "rate": Option(float, "of interest, a year's", "R", -1, 1),
    "years": Option(float, "until the options end", "T", 1e-4, 100),
    "level": Option(str, "a formula of x and y, positive in the region and negative for |x| or |y| = 1.2345: '0.5 - x**2 - 2*y**4'", "F"),
    "sites": Option(int, "points that mass is sent to", "N", 2, 100_000),
    "discontinuities": Option(
        str,
        "derivatives: exact; ignore: those of plain automatic differentiation",
        choices=("exact", "ignore", "smooth"),
    ),
    "alone": Option(bool, "without plain automatic differentiation beside it"),
    "backend": Option(str, "what programs are compiled to", choices=BACKENDS),
    "resume": Option(bool, "go on from the checkpoint in DIR"),
    "out": Option(str, "folder of the results", "DIR"),
}
"""All options that a demonstration may have."""


@dataclass(frozen=True)
class Demo:
    """A demonstration: a line and a paragraph about it, its function, the photo it takes if none is named, the defaults of its options,
    and those of --fast.

    `backends` and `treatments` (of discontinuities) are those that it has; `absent` says what happens without an option that has no
    default.
    """

    about: str
    help: str
    function: str
    defaults: Mapping[str, Any]
    fast: Mapping[str, Any] = field(default_factory=dict)
    photo: str | None = None
    backends: tuple[str, ...] = BACKENDS
    treatments: tuple[str, ...] = ("exact", "ignore")
    absent: Mapping[str, str] = field(default_factory=dict)

    def run(self, settings: Mapping[str, Any], progress: bool) -> dict[str, Any]:
        """Returns the report of a run with these settings."""
        module, _, name = self.function.partition(":")
        report: dict[str, Any] = getattr(import_module("teg.examples." + module), name)(**settings, progress=progress)
        return report


SMOOTH_HELP = "; smooth: of softened brackets, on a grid"
"""More of the help of --discontinuities, for demonstrations that have it."""
DESCENT = {"seed": 0, "backend": None, "resume": False}
COMPARED = {"discontinuities": "exact", "alone": False}
MARKET = {"spot": 100.0, "strike": 105.0, "barrier": 90.0, "volatility": 0.25, "rate": 0.03, "years": 0.5}
SMOOTHED = ("exact", "ignore", "smooth")

DEMOS = {
    "triangulation": Demo(
        "a photo in triangles",
        "Vertices follow the gradient of an exact integral, the squared difference to the photo; colours are always the best "
        "ones. Draws the mesh before and after, its error, and the same descent with the gradient of plain automatic "
        "differentiation, which is 0; writes the mesh as SVG, PLY and OBJ, to be edited and read again.",
        "triangulation.run:run_triangulation",
        {
            "triangles": 300,
            "size": 256,
            "steps": 120,
            "colours": "constant",
            "optimiser": "resilient",
            "refine": 0,
            "smoothness": 0.0,
            "keep_area": 0.0,
            "mesh": None,
            "pin": None,
            "keep_colours": False,
            **COMPARED,
            "shared_by": None,
            **DESCENT,
        },
        {"triangles": 80, "size": 96, "steps": 25},
        photo="astronaut",
        treatments=SMOOTHED,
    ),
    "perlin": Demo(
        "a photo as a thresholded noise in a few colours",
        "Perlin noise of several octaves is cut at one or two thresholds, and each region has a colour, or a map of colours. "
        "Gradients at the lattice's nodes, thresholds and colours are fitted to the photo, by derivatives that count how the "
        "regions' borders move.",
        "perlin.run:run_perlin",
        {
            "cells": 8,
            "octaves": 5,
            "noise": "smoothstep",
            "node": None,
            "levels": 3,
            "colour_cells": 6,
            "size": 256,
            "steps": 300,
            **COMPARED,
            **DESCENT,
        },
        {"size": 64, "octaves": 3, "steps": 60},
        photo="astronaut",
        treatments=SMOOTHED,
    ),
    "bouncing-ball": Demo(
        "the path of a ball by least action",
        "A ball bounces between floor and ceiling of a rising lift, or over a floor of your own. The action is an integral "
        "whose integrand jumps at each contact; the times of the contacts (and their places, over a floor) make it stationary. "
        "Ends with code 3 if they were not found.",
        "bouncing_ball.run:run_bouncing_ball",
        {"contacts": 5, "speed": 1.5, "duration": None, "floor": None, "restitution": 1.0, "steps": 300, **COMPARED, **DESCENT},
        {"contacts": 2},
        treatments=SMOOTHED,
        absent={"duration": "in the lift 0.7 of the longest possible; over a floor that of a ball dropped on a level one"},
    ),
    "billiards": Demo(
        "balls that collide, by least action",
        "Times and places of all contacts, with other balls and with cushions, make the action stationary: Newton's method with "
        "exact second derivatives through all jumps. Ends with code 3 if it does not converge.",
        "billiards.run:run_billiards",
        {"scene": "break", "balls": None, "duration": None, "steps": 20, **COMPARED, **DESCENT},
        {"scene": "exchange"},
        absent={"duration": "that of the scene"},
    ),
    "springs": Demo(
        "two bungee cords with locking strings, designed for a quick jump with a gentle stop",
        "Stiffnesses and lengths of two cords, of which the first weakens and locks, minimise time and acceleration of a jump "
        "that ends just above the ground: the springs of the Teg paper, by SciPy's SLSQP with exact derivatives, those of plain "
        "automatic differentiation, and differences.",
        "springs.run:run_springs",
        {"apex": 5.0, "mass": 1.0, "weight": 1.0, "steps": 100, **COMPARED, **DESCENT},
        {"steps": 40},
        treatments=SMOOTHED,
    ),
    "mesh-network": Demo(
        "a network in JAX that turns photos into triangles",
        "A small network sees a photo and moves the vertices of a mesh; it is trained on crops of photos through the exact "
        "integral, and shown one that it has not seen.",
        "mesh_network.run:run_mesh_network",
        {"cells": 24, "epochs": 60, "discontinuities": "exact", **DESCENT},
        {"cells": 8, "epochs": 2},
        photo="astronaut",
        backends=("jax",),
        absent={"backend": "jax"},
    ),
    "voronoi": Demo(
        "optimal transport to points",
        "Cells around sites of the unit square receive given masses of a density, at the least total of squared distances: "
        "Newton's method on the exact areas and sides of the cells.",
        "voronoi:run_voronoi",
        {"sites": 200, **DESCENT},
        {"sites": 40},
    ),
    "greeks": Demo(
        "a digital and a barrier option with all Greeks",
        "Prices are integrals of payoffs that jump; their derivatives by every parameter, first and second, are compared with "
        "closed forms and with plain automatic differentiation.",
        "greeks:run_greeks",
        {**MARKET, "seed": 0, "backend": "numpy"},
    ),
    "auction": Demo(
        "the best reserve price of an auction",
        "The expected revenue of a second-price auction is an integral that jumps where a bid reaches the reserve. Newton's "
        "method finds the best reserve for one bidder, for two, and for up to twelve.",
        "auction:run_auction",
        {"bidders": 3, "rise": 2.0, "fall": 3.0, "values": None, "seed": 0, "backend": "numpy"},
    ),
    "cut-cells": Demo(
        "finite elements on cells that a level set cuts",
        "A Poisson problem in a region that cells do not follow. Quadratures over the region in each cell, and over its "
        "boundary, are the nodes of one compiled area; energy and shape derivative are compared with closed forms and "
        "differences.",
        "cut_cells:run_cut_cells",
        {"cells": 6, "level": None, "seed": 0, "backend": "numpy"},
        {"cells": 4},
        absent={"level": "a disk and a bent one, of radius and bend that are differentiated by"},
    ),
    "occlusion": Demo(
        "the pose of a mesh from a picture",
        "A torus of triangles with its parts in front of each other. Each pixel is the integral of the nearest triangle's "
        "colour; turn and place are found from the picture alone.",
        "occlusion:run_occlusion",
        {"size": 48, "triangles": 480, "steps": 60, "discontinuities": "exact", **DESCENT},
        {"size": 16, "steps": 10},
    ),
    "soft-shadow": Demo(
        "the place of a mesh from its soft shadow",
        "A knot of triangles under a pentagon of light: place and turn are found from its shadow on the ground, an integral "
        "over the light that sees each point.",
        "soft_shadow.run:run_soft_shadow",
        {"size": 32, "triangles": 400, "steps": 60, "discontinuities": "exact", **DESCENT},
        {"size": 12, "triangles": 60, "steps": 10},
    ),
    "motion-blur": Demo(
        "the motion of a triangle from one blurred picture",
        "A pixel is an integral over its area and the time of exposure. Place, velocity and spin of a triangle are found from one picture.",
        "blur.run:run_motion_blur",
        {"size": 32, "steps": 60, "discontinuities": "exact", **DESCENT},
        {"size": 12, "steps": 10},
    ),
    "depth-of-field": Demo(
        "the focus of a lens from one picture of a slanted triangle",
        "A pixel is an integral over its area and the lens. Focus and radius of the lens are found from one picture.",
        "blur.run:run_depth_of_field",
        {"size": 24, "steps": 40, "discontinuities": "exact", **DESCENT},
        {"size": 8, "steps": 5},
    ),
    "shaders": Demo(
        "one window, several lights",
        "A light is a function that is differentiated and compiled apart from the window that it shines through: what a new one "
        "costs when the geometry is known already.",
        "shaders:run_shaders",
        {"seed": 0, "backend": "numpy"},
    ),
}
"""The demonstrations by name."""


def resolved(name: str, given: Mapping[str, Any], fast: bool = False) -> dict[str, Any]:
    """Returns the settings of a run: those given, then those of --fast, then the defaults; the backend is one that is there.

    Raises InputError for an unknown name or an impossible value.
    """
    demo = DEMOS[name]
    known = {**({"photo": None} if demo.photo else {}), **demo.defaults, "out": f"out/{name}"}
    unknown = [key for key in given if key not in known]
    if unknown:
        raise InputError(f"the demo {name} has no option {', '.join(unknown)}", None, "it has " + ", ".join(known))
    settings = known | (dict(demo.fast) if fast else {}) | dict(given)
    for key in ("out", "photo"):
        if settings.get(key) is not None:
            settings[key] = str(settings[key])
    for key, value in settings.items():
        if key != "photo":
            OPTIONS[key].check(key, value)
    if settings["backend"] is None:
        settings["backend"] = chosen_backend(demo, settings)
    if settings["backend"] not in demo.backends:
        raise InputError(f"the demo {name} does not run in {settings['backend']!r}", None, "it runs in " + ", ".join(demo.backends))
    if settings.get("discontinuities", "exact") not in demo.treatments:
        what = f"the demo {name} has no --discontinuities {settings['discontinuities']}"
        raise InputError(what, None, "it has " + ", ".join(demo.treatments))
    return settings


def chosen_backend(demo: Demo, settings: Mapping[str, Any]) -> str:
    """Returns the only backend of a demonstration, "jax" for devices of JAX, else the default one."""
    return "jax" if len(demo.backends) == 1 or settings.get("shared_by") else default_backend()


def default_backend() -> Backend:
    """Returns "c" if there is a C compiler, else "numpy"."""
    from teg.backends.c.build import find_compiler
    from teg.errors import CompilerError

    try:
        find_compiler()
    except CompilerError:
        return "numpy"
    return "c"
