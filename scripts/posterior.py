#!/usr/bin/env python3
"""Recomputes a study's report from its rows by other programs: the posterior of each variant of the model by emcee, with polynomials
fitted by numpy, and the effects by scipy. Fails where they differ.

usage: posterior.py DIRECTORY
"""

import csv
import itertools
import json
import math
import pathlib
import sys

import emcee
import numpy
from scipy import stats

TABLE_2 = {"A": {"rc": (3725, 3.6), "sm": (6477, 11.3), "cm": (3729, 3.3)}, "B": {"rc": (7617, 9.9), "sm": (8971, 20.8), "cm": (7617, 15.3)}}
TYPES = ("rc", "sm", "cm")
# Differences that two samplers of this many draws may have: of a mean in deviations of the posterior, and of the deviations.
OF_MEAN, OF_DEVIATION = 0.25, 0.25


def jobs_of(directory):
    """Values of each job, and its six figures as they are fitted."""
    times, seeds = {}, {}
    with open(directory / "rows.csv", newline="") as file:
        for row in csv.DictReader(file):
            seeds[row["job"]] = row["seed"]
            if row["status"] == "passed":
                times.setdefault(row["job"], {}).setdefault(row["type"], []).append(float(row["execution_ns"]) / 1e6)
    jobs = []
    with open(directory / "jobs.csv", newline="") as file:
        for job in csv.DictReader(file):
            of_types = times.get(job["job"], {})
            if job["reason"] or set(of_types) != set(TYPES):
                continue
            means = [numpy.mean(of_types[one]) for one in TYPES]
            mads = [numpy.mean(numpy.abs(numpy.array(of_types[one]) - numpy.mean(of_types[one]))) for one in TYPES]
            jobs.append((job, means, means + [math.log(max(mad, 1e-3)) for mad in mads], seeds[job["job"]]))
    return jobs


def terms(positions, degree):
    """Products of powers up to a degree, of positions from -1 to 1."""
    keys = positions.shape[1]
    powers = [power for power in itertools.product(range(degree + 1), repeat=keys) if sum(power) <= degree]
    return numpy.stack([numpy.prod(positions ** numpy.array(power), axis=1) for power in powers], axis=1)


def check_posterior(setup, priors, variant, jobs):
    keys = [prior["key"] for prior in priors]
    low = numpy.array([prior["min"] for prior in priors])
    high = numpy.array([prior["max"] for prior in priors])
    own = [job for job in jobs if all(job[0][key] == value for key, value in variant["values"])]
    assert len(own) == variant["jobs"], (len(own), variant["jobs"])
    positions = 2 * (numpy.array([[float(job[0][key]) for key in keys] for job in own]) - low) / (high - low) - 1
    figures = numpy.array([job[2] for job in own])
    rows = terms(positions, variant["degree"])
    coefficients, *_ = numpy.linalg.lstsq(rows, figures, rcond=None)
    leverage = numpy.sum(rows * (rows @ numpy.linalg.inv(rows.T @ rows)), axis=1)
    left_out = (figures - rows @ coefficients) / (1 - leverage)[:, None]
    paper = [TABLE_2[setup][one][0] for one in TYPES] + [math.log(TABLE_2[setup][one][1]) for one in TYPES]
    rounding = [1 / 12**0.5] * 3 + [0.1 / 12**0.5 / TABLE_2[setup][one][1] for one in TYPES]
    noise = stats.multivariate_normal(cov=numpy.cov(left_out.T) + numpy.diag(numpy.square(rounding)))

    def log_probability(points):
        inside = numpy.all(numpy.abs(points) <= 1, axis=1)
        predicted = terms(numpy.clip(points, -1, 1), variant["degree"]) @ coefficients
        return numpy.where(inside, noise.logpdf(paper - predicted), -numpy.inf)

    random = numpy.random.default_rng(1)
    # From the report's own draws only the place to begin is taken: the walk forgets it.
    begin = 2 * (numpy.array(variant["draws"]) - low) / (high - low) - 1
    walkers = 64
    start = numpy.clip(begin[random.integers(len(begin), size=walkers)] + random.normal(0, 0.02, (walkers, len(keys))), -0.999, 0.999)
    sampler = emcee.EnsembleSampler(walkers, len(keys), log_probability, vectorize=True)
    sampler.random_state = numpy.random.RandomState(2).get_state()
    sampler.run_mcmc(start, 6000)
    draws = low + (sampler.get_chain(discard=2000, thin=10, flat=True) + 1) / 2 * (high - low)
    for index, found in enumerate(variant["posterior"]):
        mean, deviation = draws[:, index].mean(), draws[:, index].std()
        of_mean, of_deviation = abs(mean - found["mean"]) / deviation, abs(deviation / found["deviation"] - 1)
        print(f"  {found['key']}: emcee {mean:.6g} ± {deviation:.3g}, report {found['mean']:.6g} ± {found['deviation']:.3g}")
        assert of_mean < OF_MEAN and of_deviation < OF_DEVIATION, (found["key"], of_mean, of_deviation)


def check_effects(report, jobs):
    """Means and intervals of each value of each key that forms the grid."""
    checked = 0
    for effects in (one for one in report["effects"] if not one["is_drawn"]):
        for figure in (one for one in effects["figures"] if one["figure"] == "AET"):
            index = TYPES.index(figure["type"])
            for level in figure["levels"]:
                of_seeds = {}
                for job in jobs:
                    if job[0][effects["key"]] == level["value"]:
                        of_seeds.setdefault(job[3], []).append(job[1][index])
                # Jobs of one seed are one sample.
                values = [numpy.mean(one) for one in of_seeds.values()]
                margin = stats.sem(values) * stats.t.ppf(0.975, len(values) - 1)
                found = level["mean"]
                assert abs(found["value"] - numpy.mean(values)) < 1e-6 and abs(found["margin"] / margin - 1) < 0.005, (level, margin)
                checked += 1
    return checked


def main(directory):
    report = json.loads((directory / "report.json").read_text())
    jobs = jobs_of(directory)
    print(f"{check_effects(report, jobs)} means and intervals as by scipy")
    for variant in report["identification"]["variants"]:
        print(", ".join(f"{key} = {value}" for key, value in variant["values"]))
        check_posterior(report["setup"], report["identification"]["priors"], variant, jobs)


main(pathlib.Path(sys.argv[1]))
