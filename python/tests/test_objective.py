"""Tests that optimisers of other libraries find, with `trilink.Objective`, the fit of the program."""

import pickle

import numpy
import pytest
import scipy.optimize
import trilink

CAMPAIGN = "kinematic-skewed"
# J has no derivative at its minimum, which a simplex search approaches as far as the arithmetic allows.
OPTIONS = {"xatol": 1e-9, "fatol": 1e-13, "maxfev": 4000}


@pytest.fixture(scope="module")
def objective(project):
    return trilink.Objective(CAMPAIGN, "skid-roll", config=project[0] / "pipeline.toml")


@pytest.fixture(scope="module")
def fitted(project, objective):
    """Returns J and the coefficients that the program has fitted."""
    fits = trilink.read("fits", folder=project[0] / "derived", where="model = 'skid-roll'")
    return fits["j"][0], numpy.array([fits[name][0] for name in objective.names])


def test_the_objective_of_the_fit_is_that_of_the_program(objective, fitted):
    j, values = fitted
    assert objective(values) == pytest.approx(j, rel=1e-9)
    assert numpy.abs(objective.residuals(values)).sum() == pytest.approx(j, rel=1e-9)
    assert len(objective.bounds) == len(objective.x0) == len(objective.names) == 3
    count = len(objective.residuals(values))
    described = (objective.trials, objective.metrics, objective.measured, objective.standard_errors)
    assert all(len(part) == count for part in described) and len(objective.weights) == count
    assert set(objective.trials) == {
        f"{CAMPAIGN}-{omega}-r1" for omega in ("1.00", "2.00", "3.00", "3.90", "5.00")
    }
    with pytest.raises(
        ValueError, match=r"x: found an array of shape \(2,\), needed 3 numbers: skid0"
    ):
        objective([1, 2])
    with pytest.raises(ValueError, match="model: found `skids`, needed"):
        trilink.Objective(CAMPAIGN, "skids")
    with pytest.raises(ValueError, match="found campaign `none`, needed one of"):
        trilink.Objective("none", "skid")


def test_derivatives_agree_with_differences(objective):
    x = numpy.array([80.0, 75.0, 110.0])
    jacobian = objective.jacobian(x)
    for column, step in enumerate(1e-4 * x):
        moved = [x.copy(), x.copy()]
        moved[0][column] += step
        moved[1][column] -= step
        difference = (objective.residuals(moved[0]) - objective.residuals(moved[1])) / (2 * step)
        numpy.testing.assert_allclose(jacobian[:, column], difference, atol=1e-8)
    numpy.testing.assert_allclose(
        objective.gradient(x), numpy.sign(objective.residuals(x)) @ jacobian
    )


def test_values_do_not_depend_on_earlier_calls(objective):
    first = objective.residuals(objective.x0)
    objective([500.0, 5.0, 300.0])
    numpy.testing.assert_array_equal(objective.residuals(objective.x0), first)
    # As in another process.
    again = pickle.loads(pickle.dumps(objective))
    numpy.testing.assert_array_equal(again.residuals(again.x0), first)
    with_nothing_free = trilink.Objective(CAMPAIGN, "no-skid", config=objective._arguments[2])
    assert with_nothing_free([]) > 0 and with_nothing_free.gradient([]).shape == (0,)


def test_scipy_finds_the_fit(objective, fitted):
    j, values = fitted
    found = scipy.optimize.minimize(
        objective, objective.x0, method="Nelder-Mead", bounds=objective.bounds, options=OPTIONS
    )
    assert found.success
    numpy.testing.assert_allclose(found.x, values, rtol=1e-6)
    assert found.fun == pytest.approx(j, rel=1e-9)
    # With derivatives: a smooth loss that approaches the magnitudes of the residuals.
    x = objective.x0
    exactly = {"xtol": 1e-14, "ftol": 1e-14, "gtol": 1e-14}
    for scale in (1e-2, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8):
        least = scipy.optimize.least_squares(
            objective.residuals,
            x,
            objective.jacobian,
            x_scale=x,
            loss="soft_l1",
            f_scale=scale,
            **exactly,
        )
        x = least.x
    numpy.testing.assert_allclose(x, values, rtol=1e-6)


def test_pypesto_finds_the_fit_from_several_starts(objective, fitted):
    pypesto = pytest.importorskip("pypesto")
    from pypesto import optimize

    _, values = fitted
    problem = pypesto.Problem(
        pypesto.Objective(fun=objective, grad=objective.gradient),
        lb=values / 3,
        ub=values * 3,
        x_names=objective.names,
    )
    numpy.random.seed(1)
    result = optimize.minimize(
        problem,
        optimizer=optimize.ScipyOptimizer("nelder-mead", options=OPTIONS),
        n_starts=3,
        progress_bar=False,
    )
    numpy.testing.assert_allclose(result.optimize_result[0].x, values, rtol=1e-6)


def test_emcee_samples_the_posterior(objective, fitted):
    emcee = pytest.importorskip("emcee")
    _, values = fitted
    numpy.random.seed(1)
    sampler = emcee.EnsembleSampler(8, 3, objective.log_prob)
    start = values * (1 + 1e-4 * numpy.random.standard_normal((8, 3)))
    sampler.run_mcmc(start, 40)
    samples = sampler.get_chain(discard=20, flat=True)
    assert 0.1 < sampler.acceptance_fraction.mean() < 0.9
    numpy.testing.assert_allclose(samples.mean(axis=0), values, rtol=1e-2)
