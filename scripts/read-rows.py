#!/usr/bin/env python3
"""Reads the rows of a study with pandas, Polars and DuckDB, which must agree on counts and sums; scipy checks an interval.

usage: read-rows.py DIRECTORY
"""

import csv
import hashlib
import json
import pathlib
import statistics
import sys

import duckdb
import pandas
import polars
from scipy import stats


def main(directory):
    path = directory / "rows.csv"
    schema = json.loads((directory / "rows.schema.json").read_text())
    names = [field["name"] for field in schema["fields"]]
    with open(path, newline="") as file:
        plain = list(csv.DictReader(file))
    assert list(plain[0]) == names, (list(plain[0]), names)
    keys = [tuple(row[name] for name in schema["primaryKey"]) for row in plain]
    assert len(set(keys)) == len(keys), "a repetition stands twice"
    assert keys == sorted(keys, key=lambda key: (key[0], key[1], int(key[2]))), "not sorted"
    times = [int(row["execution_ns"]) for row in plain if row["status"] == "passed"]
    wanted = (len(plain), len(times), sum(times))

    frame = pandas.read_csv(path, dtype={"job": str})
    passed = frame[frame.status == "passed"]
    found = {"pandas": (len(frame), len(passed), int(passed.execution_ns.sum()))}

    frame = polars.read_csv(path, schema_overrides={"job": polars.String})
    passed = frame.filter(polars.col("status") == "passed")
    found["Polars"] = (len(frame), len(passed), passed["execution_ns"].sum())

    rows = f"read_csv('{path}', types = {{'job': 'VARCHAR'}})"
    found["DuckDB"] = duckdb.sql(
        f"select count(*), count(*) filter (status = 'passed'), sum(execution_ns) filter (status = 'passed') from {rows}"
    ).fetchall()[0]
    parquet = directory / "rows.parquet"
    duckdb.execute(f"copy (select * from {rows}) to '{parquet}'")
    found["Parquet"] = duckdb.sql(
        f"select count(*), count(*) filter (status = 'passed'), sum(execution_ns) filter (status = 'passed') from '{parquet}'"
    ).fetchall()[0]
    parquet.unlink()
    for reader, values in found.items():
        assert tuple(values) == wanted, (reader, values, wanted)

    mean, error = statistics.fmean(times), statistics.stdev(times) / len(times) ** 0.5
    low, high = stats.t.interval(0.95, len(times) - 1, loc=mean, scale=stats.sem(times))
    factor = stats.t.ppf(0.975, len(times) - 1)
    assert abs(low - (mean - factor * error)) < 1 and abs(high - (mean + factor * error)) < 1
    largest = max(len(line) for line in path.read_bytes().splitlines())
    assert largest <= 100, largest
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    print(f"{', '.join(found)}: {wanted[0]} rows, {wanted[1]} passed, sum {wanted[2]} ns; sha256:{digest}")


main(pathlib.Path(sys.argv[1]))
