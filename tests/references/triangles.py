"""Triangles: polynomials on them, slivers, pixels of pictures."""

from __future__ import annotations

from teg import Expr, bracket, exp, integral, where
from tests.references.problem import Reference, a, ax, ay, b, bx, by, c, cx, cy, k0, k1, k2, q0, q1, q2, q3, q4, q5, t, u, v, w, x, y


def _left(px: Expr, py: Expr, qx: Expr, qy: Expr) -> Expr:
    """1 to the left of the line from p to q."""
    return bracket((qx - px) * (y - py) - (qy - py) * (x - px) > 0)


def _triangle_loss() -> Expr:
    """The squared difference of a triangle's constant colour and a target, over three channels."""
    inside = _left(ax, ay, bx, by) * _left(bx, by, cx, cy) * _left(cx, cy, ax, ay)
    return (inside * k0 - 0.25) ** 2 + (inside * k1 - 0.5) ** 2 + (inside * k2 - 0.75) ** 2


TRIANGLES: tuple[Reference, ...] = (
    Reference(
        "power-0-on-a-triangle",
        lambda: integral((x + 2 * y) ** 0 * bracket(u * x + v * y < w), (x, 0, 1), (y, 0, 1)),
        {"u": 1.0, "v": 0.75, "w": 0.7},
        "0.3266666666666666252183404",
        {"u": "-0.3266666666666666252183404", "v": "-0.4355555555555555002911206", "w": "0.9333333333333332741214387"},
        {("w", "w"): "1.333333333333333333333333"},
        ("2d-affine", "exact"),
        "polygon clipping, Gauss in 40 digits",
    ),
    Reference(
        "power-1-on-a-triangle",
        lambda: integral((x + 2 * y) ** 1 * bracket(u * x + v * y < w), (x, 0, 1), (y, 0, 1)),
        {"u": 1.0, "v": 0.75, "w": 0.7},
        "0.2794814814814814282894628",
        {"u": "-0.3557037037037036360047708", "v": "-0.6436543209876541984848234", "w": "1.197777777777777625800582"},
        {("w", "w"): "3.422222222222222005111942"},
        ("2d-affine", "exact"),
        "polygon clipping, Gauss in 40 digits",
    ),
    Reference(
        "power-2-on-a-triangle",
        lambda: integral((x + 2 * y) ** 2 * bracket(u * x + v * y < w), (x, 0, 1), (y, 0, 1)),
        {"u": 1.0, "v": 0.75, "w": 0.7},
        "0.2875271604938270875294217",
        {"u": "-0.4120234567901233522328827", "v": "-0.9841135802469133305130723", "w": "1.643012345679012032974418"},
        {("w", "w"): "7.041481481481480588039782"},
        ("2d-affine", "exact"),
        "polygon clipping, Gauss in 40 digits",
    ),
    Reference(
        "power-3-on-a-triangle",
        lambda: integral((x + 2 * y) ** 3 * bracket(u * x + v * y < w), (x, 0, 1), (y, 0, 1)),
        {"u": 1.0, "v": 0.75, "w": 0.7},
        "0.3332350864197529807153915",
        {"u": "-0.5062849382716047776746919", "v": "-1.546520658436213501203021", "w": "2.380250617283950013259027"},
        {("w", "w"): "13.60143209876542951008719"},
        ("2d-affine", "exact"),
        "polygon clipping, Gauss in 40 digits",
    ),
    Reference(
        "power-4-on-a-triangle",
        lambda: integral((x + 2 * y) ** 4 * bracket(u * x + v * y < w), (x, 0, 1), (y, 0, 1)),
        {"u": 1.0, "v": 0.75, "w": 0.7},
        "0.4199213964334703477023864",
        {"u": "-0.6561877009602192289615307", "v": "-2.484454236854137143003717", "w": "3.599326255144031780080733"},
        {("w", "w"): "25.7094732510288000601909"},
        ("2d-affine", "exact"),
        "polygon clipping, Gauss in 40 digits",
    ),
    Reference(
        "power-5-on-a-triangle",
        lambda: integral((x + 2 * y) ** 5 * bracket(u * x + v * y < w), (x, 0, 1), (y, 0, 1)),
        {"u": 1.0, "v": 0.75, "w": 0.7},
        "0.5625096174668493158105462",
        {"u": "-0.890603467946958909476606", "v": "-4.062618472427981734929623", "w": "5.625096174668493514968964"},
        {("w", "w"): "48.21511006858709032999257"},
        ("2d-affine", "exact"),
        "polygon clipping, Gauss in 40 digits",
    ),
    Reference(
        "sliver-1e-6",
        lambda: integral(bracket((x + 2 * y > t) & (x + 2 * y < t + w)) * exp(x - y), (x, 0, 1), (y, 0, 1)),
        {"t": 0.8, "w": 1e-06},
        "0.0000005184073876025490319674442",
        {"t": "0.0000008535673268303768702752996", "w": "0.5184078143862696362278939"},
        {},
        ("2d-affine", "sliver", "relative"),
        "polygon clipping, Gauss in 40 digits",
        1e-9,
    ),
    Reference(
        "sliver-triangle",
        lambda: integral(bracket((y < w * x) & (x + y < 1) & (y > 0.5 * w * x)), (x, 0, 1), (y, 0, 1)),
        {"w": 1e-06},
        "0.0000002499996250004374882183124",
        {"w": "0.2499992500013124981250364"},
        {},
        ("2d-affine", "sliver", "relative"),
        "polygon clipping in 40 digits",
    ),
    Reference(
        "two-triangles-share-an-edge",
        lambda: integral(where(x + y < t, a, b) * (1 + y), (x, 0, 1), (y, 0, 1)),
        {"t": 0.75, "a": 2.0, "b": -1.0},
        "-0.4453125",
        {"t": "3.09375", "a": "0.3515625", "b": "1.1484375"},
        {("t", "t"): "5.25", ("a", "t"): "1.03125"},
        ("2d-affine",),
        "closed form",
    ),
    Reference(
        "squared-residual",
        lambda: integral((where(x + c * y < t, a, b) - x * y) ** 2, (x, 0, 1), (y, 0, 1)),
        {"t": 0.75, "a": 0.6, "b": -0.2, "c": 0.5},
        "0.3361111111111111066008301",
        {
            "t": "-0.01333333333333335979364875",
            "a": "0.5062499999999999777955395",
            "b": "-0.6062500000000000111022302",
            "c": "0.04000000000000001276756478",
        },
        {("a", "t"): "0.7833333333333332889244123"},
        ("2d-affine",),
        "polygon clipping, Gauss in 40 digits",
    ),
    Reference(
        "tri-inside-quadratic-colour",
        lambda: integral(
            _left(ax, ay, bx, by)
            * _left(bx, by, cx, cy)
            * _left(cx, cy, ax, ay)
            * (q0 + q1 * x + q2 * y + q3 * x**2 + q4 * x * y + q5 * y**2),
            (x, 0, 1),
            (y, 0, 1),
        ),
        {
            "ax": 0.15,
            "ay": 0.2,
            "bx": 0.85,
            "by": 0.3,
            "cx": 0.4,
            "cy": 0.9,
            "q0": 0.3,
            "q1": -0.5,
            "q2": 0.8,
            "q3": 1.1,
            "q4": -0.7,
            "q5": 0.4,
        },
        "0.15050500000000001137359882201",
        {
            "ax": "-0.188581250000000020146615857068",
            "ay": "-0.0798718749999999903189708735004",
            "bx": "0.26066666666666669571403303074",
            "by": "-0.0230822916666666747074569225144",
            "cx": "-0.0255854166666666537376569519798",
            "cy": "0.299804166666666686196067910982",
            "q0": "0.232499999999999999444888487687",
            "q1": "0.108499999999999999310736538879",
            "q2": "0.10850000000000000146179364909",
            "q3": "0.0555093749999999991468629945146",
            "q4": "0.0504718750000000005893433889052",
            "q5": "0.0561875000000000018017994503812",
        },
        {},
        ("2d-affine", "triangle"),
        "polygon moments; edge integrals for vertex gradients",
    ),
    Reference(
        "tri-pixel-constant-colour-loss",
        lambda: integral(_triangle_loss(), (x, 0, 1), (y, 0, 1)),
        {"ax": -0.3, "ay": 0.25, "bx": 1.2, "by": -0.1, "cx": 0.55, "cy": 1.3, "k0": 0.9, "k1": 0.2, "k2": 0.4},
        "0.690599638009049776380744811602",
        {
            "ax": "0.0659200395452298589248445944192",
            "ay": "0.0661267707082833034692686989112",
            "bx": "-0.0530578529163144606472386271434",
            "by": "0.0508337519623233860243080506063",
            "cx": "-0.0392187477148882519485020023304",
            "cy": "-0.0801033798134638366692605963248",
            "k0": "0.998835294117647106448468742527",
            "k1": "-0.461000904977375554783022812005",
            "k2": "-0.537834389140271466363142750703",
        },
        {},
        ("2d-affine", "triangle", "image"),
        "loss int sum_k ([tri] c_k - T_k)^2; triangle clipped by the pixel on several sides",
    ),
)
