"""Objective of a fit for optimisers and samplers."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from typing import TYPE_CHECKING

from . import _trilink
from ._call import Pathlike
from ._commands import path_text

if TYPE_CHECKING:
    import numpy
    from numpy.typing import ArrayLike

    Floats = numpy.ndarray[tuple[int, ...], numpy.dtype[numpy.float64]]


class Objective:
    """Objective J (eq. 22 of the paper) of a model of a campaign, with exact derivatives.

    J is the sum of the magnitudes of the residuals, which are the weighted relative deviations of the simulated from
    the measured metrics. `x` has the free parameters in SI units, in the order of `names`. The value at `x` does not
    depend on earlier calls. J is infinite, and the residuals are NaN, where the model has no steady-state motion.

    J has no derivative where a residual is zero, as at its minimum; methods for smooth functions therefore stop short of
    it. The gradient is NaN where J is infinite.

    campaign, model: names in the configuration; the trials are those in the folder of tables.
    config: path of a `pipeline.toml`, as for `trilink.run`.

    >>> import scipy.optimize, trilink
    >>> objective = trilink.Objective("kinematic-skewed", "skid-roll")
    >>> objective.names
    ['skid0_kg_s', 'skid1_kg_s', 'skid2_kg_s']
    >>> fit = trilink.read("fits", where="model = 'skid-roll'")
    >>> at = [fit[name][0] for name in objective.names]
    >>> bool(abs(objective(at) / fit["j"][0] - 1) < 1e-9)
    True
    >>> objective.jacobian(at).shape == (len(objective.residuals(at)), 3)
    True
    """

    def __init__(self, campaign: str, model: str, *, config: Pathlike | None = None) -> None:
        import numpy

        # Other processes may have another current folder.
        path = None if config is None else os.path.abspath(config)
        self._arguments = (campaign, model, path)
        described, self._evaluate = _trilink.objective(path_text(config), campaign, model)
        known = json.loads(described)
        self.names: list[str] = known["names"]
        """Names of the free parameters, including the units."""
        self.bounds: list[tuple[float, float]] = [(low, high) for low, high in known["bounds"]]
        """Bounds of the free parameters, as scipy takes them."""
        self.x0: Floats = numpy.array(known["x0"], dtype=float)
        """First start of the search of `trilink.fit`: the configured values, if they are within the bounds."""
        self.trials: list[str] = known["trials"]
        """Trial of each residual."""
        self.metrics: list[str] = known["metrics"]
        """Metric of each residual, such as `d_m`."""
        self.measured: Floats = numpy.array(known["measured"], dtype=float)
        """Measured value of each residual's metric."""
        self.standard_errors: Floats = numpy.array(known["standard_errors"], dtype=float)
        """Standard error of each measured value; NaN if unknown."""
        self.weights: Floats = numpy.array(known["weights"], dtype=float)
        """Weight of each relative deviation in J."""

    def __call__(self, x: ArrayLike) -> float:
        """Returns J.

        >>> import trilink
        >>> objective = trilink.Objective("kinematic-skewed", "skid-roll")
        >>> objective(objective.x0) > objective([73, 83, 97])
        True
        """
        return self._evaluate(self._values(x), False)[0]

    def gradient(self, x: ArrayLike) -> Floats:
        """Returns the derivatives of J, per unit of each parameter.

        >>> import scipy.optimize, trilink
        >>> objective = trilink.Objective("kinematic-skewed", "skid-roll")
        >>> x = [73, 80, 99]
        >>> bool(scipy.optimize.check_grad(objective, objective.gradient, x, epsilon=1e-5) < 1e-6)
        True
        """
        import numpy

        _, residuals, jacobian = self._evaluate(self._values(x), True)
        signs = numpy.sign(numpy.frombuffer(residuals))
        return signs @ numpy.frombuffer(jacobian).reshape(len(self.trials), len(self.names))

    def residuals(self, x: ArrayLike) -> Floats:
        """Returns the residuals: J is the sum of their magnitudes.

        >>> import trilink
        >>> objective = trilink.Objective("kinematic-skewed", "skid-roll")
        >>> round(float(abs(objective.residuals(objective.x0)).sum() - objective(objective.x0)), 12)
        0.0
        """
        import numpy

        return numpy.frombuffer(self._evaluate(self._values(x), False)[1])

    def jacobian(self, x: ArrayLike) -> Floats:
        """Returns the derivatives of the residuals: a row for each residual, a column for each parameter.

        >>> import trilink
        >>> objective = trilink.Objective("kinematic-skewed", "skid-roll")
        >>> objective.jacobian([73, 83, 97]).shape[1]
        3
        """
        import numpy

        return numpy.frombuffer(self._evaluate(self._values(x), True)[2]).reshape(
            len(self.trials), len(self.names)
        )

    def log_prob(self, x: ArrayLike) -> float:
        """Returns the logarithm of the posterior density up to a constant, for samplers: independent normal errors with
        the standard errors of the trial means, and a uniform prior within the bounds. Metrics without a standard error
        are left out.

        >>> import trilink
        >>> objective = trilink.Objective("kinematic-skewed", "skid-roll")
        >>> objective.log_prob([73, 83, 97]) > objective.log_prob(objective.x0)
        True
        >>> objective.log_prob([-1, 83, 97])
        -inf
        """
        import numpy

        values = self._values(x)
        if any(not low <= value <= high for value, (low, high) in zip(values, self.bounds)):
            return float("-inf")
        known = self.standard_errors > 0
        deviations = self.residuals(values) / self.weights * self.measured
        deviations = deviations[known] / self.standard_errors[known]
        if not numpy.isfinite(deviations).all():
            return float("-inf")
        return -0.5 * float(numpy.sum(deviations**2))

    def _values(self, x: ArrayLike) -> list[float]:
        import numpy

        values = numpy.asarray(x, dtype=float)
        if values.shape != (len(self.names),):
            needed = f"needed {len(self.names)} numbers: {', '.join(self.names)}"
            raise ValueError(f"x: found an array of shape {values.shape}, {needed}")
        found: list[float] = values.tolist()
        return found

    def __reduce__(self) -> tuple[Callable[..., Objective], tuple[str, str, str | None]]:
        """Sets the objective up again in another process."""
        return _objective, self._arguments

    def __repr__(self) -> str:
        return f"<trilink.Objective of {', '.join(self.names)}: {len(self.trials)} residuals>"


def _objective(campaign: str, model: str, config: str | None) -> Objective:
    return Objective(campaign, model, config=config)
