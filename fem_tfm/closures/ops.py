# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mathematics that works alike on UFL expressions, numpy arrays and plain numbers.

A function takes the UFL path if any argument is a UFL expression and the numpy path otherwise, so
that a weak form and a unit test call the same law. Tensors are UFL expressions or numpy arrays of
shape (3, 3). The regularised primitives have a finite derivative everywhere, since Newton's method
differentiates them symbolically.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.special
import ufl
from ufl.core.expr import Expr

type Value = Any
"""A float, a numpy array or a scalar UFL expression."""


def is_expr(*args: Value) -> bool:
    """Whether any argument is a UFL expression."""
    return any(isinstance(a, Expr) for a in args)


def _plain(x: Value) -> Value:
    """Python float of a numpy scalar, which would not multiply a UFL expression reliably."""
    return float(x) if isinstance(x, np.number | np.bool_) else x


def _both(symbolic: Callable, numeric: Callable, doc: str) -> Callable[..., Value]:
    """One function from its UFL and its numpy form."""

    def function(*args: Value) -> Value:
        return symbolic(*args) if is_expr(*args) else _plain(numeric(*args))

    function.__doc__ = doc
    function.__name__ = function.__qualname__ = symbolic.__name__
    return function


sqrt = _both(ufl.sqrt, np.sqrt, "Square root.")
exp = _both(ufl.exp, np.exp, "Exponential.")
ln = _both(ufl.ln, np.log, "Natural logarithm.")
erf = _both(ufl.erf, scipy.special.erf, "Error function.")
sin = _both(ufl.sin, np.sin, "Sine of an angle in rad.")
cos = _both(ufl.cos, np.cos, "Cosine of an angle in rad.")
tan = _both(ufl.tan, np.tan, "Tangent of an angle in rad.")
acos = _both(ufl.acos, np.arccos, "Arc cosine, in rad; its slope is infinite at -1 and 1.")
atan = _both(ufl.atan, np.arctan, "Arc tangent, in rad.")
maximum = _both(ufl.max_value, np.maximum, "Larger of two values; has a kink.")
minimum = _both(ufl.min_value, np.minimum, "Smaller of two values; has a kink.")


def where_greater(a: Value, b: Value, yes: Value, no: Value) -> Value:
    """`yes` where a > b, else `no`; both branches are evaluated and must be finite."""
    if is_expr(a, b, yes, no):
        return ufl.conditional(ufl.gt(a, b), yes, no)
    found: Value = np.where(np.greater(a, b), yes, no)
    return _plain(found[()])


def tanh(x: Value) -> Value:
    """Hyperbolic tangent, written so that neither it nor its derivative overflows.

    UFL differentiates its own tanh to a quotient of cosh, which is inf/inf beyond |x| = 355.
    """
    decay = exp(where_greater(x, 0.0, -2 * x, 2 * x))
    return where_greater(x, 0.0, 1.0, -1.0) * (1 - decay) / (1 + decay)


def smooth_norm(x: Value, eps: Value) -> Value:
    """Regularised modulus sqrt(x^2 + eps^2) of a scalar; eps has the unit of x."""
    return sqrt(x * x + eps * eps)


def positive_part(x: Value, eps: Value) -> Value:
    """Smooth max(x, 0) = [x + sqrt(x^2 + 4 eps^2)]/2 in a form that never cancels to zero.

    It exceeds max(x, 0) by eps at x = 0 and by eps^2/|x| far away.
    """
    size = where_greater(x, 0.0, x, -x)
    return where_greater(x, 0.0, x, 0.0) + 2 * eps * eps / (size + smooth_norm(x, 2 * eps))


def softplus(x: Value, width: Value) -> Value:
    """Smooth max(x, 0) = width ln(1 + exp(x/width)); the error decays as width exp(-|x|/width).

    Written so that no exponential overflows, whatever x/width.
    """
    decay = exp(where_greater(x, 0.0, -x, x) / width)
    return where_greater(x, 0.0, x, 0.0) + width * ln(1 + decay)


def smooth_step(x: Value, centre: Value, width: Value) -> Value:
    """Cubic step t^2 (3 - 2t) from 0 to 1 across [centre - width/2, centre + width/2]; C1.

    It is exactly 0 and 1 outside, so a blended law is exactly its branch there.
    """
    t = minimum(maximum((x - centre) / width + 0.5, 0.0), 1.0)
    return t * t * (3 - 2 * t)


def safe_pow(x: Value, n: Value, eps: Value) -> Value:
    """x (x^2 + eps^2)^((n - 1)/2), which is x^n for x >> eps and linear at x = 0.

    For 0 < n < 1 and x >= 0, where x^n has an infinite slope at zero; relative error
    (1 - n)/2 (eps/x)^2.
    """
    return x * (x * x + eps * eps) ** ((n - 1) / 2)


def lambert_w(x: Value, iterations: int = 1) -> Value:
    """Principal Lambert function W, the solution of w exp(w) = x, for x >= 1.

    Start of Iacono and Boyd (2017, Adv. Comput. Math. 43), then Fritsch's fourth-order step
    (Fritsch, Shafer and Crowley 1973, Commun. ACM 16) unrolled, so that it can be differentiated;
    relative error below 3e-9 after one step and at round-off after two.
    """
    outer = ln(1 + x)
    w = outer * (1 - ln(1 + outer) / (2 + outer))
    for _ in range(iterations):
        z = ln(x / w) - w
        q = 2 * (1 + w) * (1 + w + 2 * z / 3)
        w = w * (1 + z / (1 + w) * (q - z) / (q - 2 * z))
    return w


def radians(angle_deg: Value) -> Value:
    """Angle in rad of an angle in degrees."""
    return angle_deg * (math.pi / 180)


type Tensor = Any
"""A UFL expression or a numpy array of shape (3, 3), or (3,) for a vector."""


def dot(a: Tensor, b: Tensor) -> Tensor:
    """Product summed over the last index of a and the first of b."""
    return ufl.dot(a, b) if is_expr(a, b) else np.dot(a, b)


def outer(a: Tensor, b: Tensor) -> Tensor:
    """Product a_i b_j of two vectors."""
    return ufl.outer(a, b) if is_expr(a, b) else np.outer(a, b)


def transpose(a: Tensor) -> Tensor:
    """a_ji."""
    return ufl.transpose(a) if is_expr(a) else np.transpose(a)


def trace(a: Tensor) -> Any:
    """a_kk."""
    return ufl.tr(a) if is_expr(a) else np.trace(a)


def identity(like: Tensor) -> Tensor:
    """delta_ij of the kind of `like`."""
    return ufl.Identity(3) if is_expr(like) else np.eye(3)


def symmetric(a: Tensor) -> Tensor:
    """(a_ij + a_ji)/2."""
    return (a + transpose(a)) / 2


def deviator(a: Tensor) -> Tensor:
    """a_ij - a_kk delta_ij/3."""
    return a - trace(a) / 3 * identity(a)
