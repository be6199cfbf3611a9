#!/usr/bin/env python3
"""Compares how long motions take with a reference that shares no code with the robot: a row of linear programs.

usage: optimum.py PATHS [MOST_SINGULAR MOST_ELSEWHERE]

PATHS comes from `cargo run -p robot-node --example near_optimum -- SETUP COUNT SEED PATHS`: for each motion the joints and the
tool at even steps of a parameter u, the limits, and how long the robot takes. With b = (du/dt)² at each whole step, speed and
acceleration are linear in b. The jerk limit holds the change of acceleration over a step by the step's time, which falls with
√b: it is linear around the b of the last program. The time is not linear either: each program maximises the sum of b weighed by
the slope of the time around the last b, within a trust region, and a step counts only if it keeps all limits (a law that exceeds
the jerk is slowed down as a whole until it does not). So what comes out is a law within the limits, and its time is an upper
bound of the optimum. Needs scipy.
"""

import json
import sys
from collections import defaultdict

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import coo_matrix, vstack

STEPS = 120  # of a law at most
ROUNDS = 14
MARGIN = 1e-3  # a trust region ends when the time changes by less than this share


def channels(path):
    joints, tool = np.array(path["joints"]), np.array(path["tool"])
    steps = (len(joints) - 1) // 2
    for wanted in range(STEPS, 40, -1):
        if steps % wanted == 0 or steps <= STEPS:
            break
    else:
        wanted = steps
    stride = max(1, steps // wanted)
    return joints[::stride], tool[::stride], path["half"] * stride


class Program:
    def __init__(self, path):
        joints, tool, half = channels(path)
        self.step = 2 * half
        self.nodes = (len(joints) - 1) // 2 + 1
        self.speed, self.acceleration, self.jerk = [], [], []
        finite = lambda value: value is not None
        for axis in range(path["axes"]):
            limits = [row[axis] for row in path["joint_limits"]]
            if all(map(finite, limits)) and np.ptp(joints[:, axis]) > 1e-9:
                self.add(joints[:, axis], limits)
        if all(map(finite, path["tool_limits"])):
            # A vector within a ball, by the faces of a polyhedron around a smaller one: along and across at each place.
            self.tool = tool if np.ptp(tool, axis=0).max() > 1e-9 else None
            self.tool_limits = path["tool_limits"]
        else:
            self.tool = None

    def add(self, q, limits):
        h = self.step
        first = (q[2::2] - q[:-2:2]) / h
        second = (q[2::2] - 2 * q[1::2] + q[:-2:2]) / (h / 2) ** 2
        self.speed.append((first, limits[0]))
        self.acceleration.append((second / 2 - first / (2 * h), second / 2 + first / (2 * h), limits[1]))
        self.jerk.append(limits[2])

    def prepare_tool(self):
        """The tool as channels: what a direction at each step takes of its limits."""
        if self.tool is None:
            return []
        h, p = self.step, self.tool
        first = (p[2::2] - p[:-2:2]) / h
        second = (p[2::2] - 2 * p[1::2] + p[:-2:2]) / (h / 2) ** 2
        return [(first, second)]

    def tops(self):
        top = np.full(self.nodes - 1, np.inf)
        for first, limit in self.speed:
            with np.errstate(divide="ignore"):
                top = np.minimum(top, (limit / np.abs(first)) ** 2)
        for first, _ in self.prepare_tool():
            size = np.linalg.norm(first, axis=1)
            with np.errstate(divide="ignore"):
                top = np.minimum(top, (self.tool_limits[0] / size) ** 2)
        return top

    def accelerations(self):
        """Pairs of factors with a limit each, for the joints."""
        return self.acceleration

    def tool_accelerations(self):
        found = []
        for first, second in self.prepare_tool():
            before = second / 2 - first / (2 * self.step)
            after = second / 2 + first / (2 * self.step)
            found.append((before, after))
        return found

    def times(self, b):
        root = np.sqrt(np.maximum(b, 0))
        return 2 * self.step / np.maximum(root[1:] + root[:-1], 1e-12)

    def used(self, b):
        """The largest used shares of speed (squared), acceleration and jerk."""
        middle = (b[1:] + b[:-1]) / 2
        speed = (middle / self.tops()).max()
        times = self.times(b)
        at = np.zeros(self.nodes)
        at[:-1] += times / 2
        at[1:] += times / 2
        acceleration, jerk = 0.0, 0.0
        for (before, after, most), jerk_most in zip(self.acceleration, self.jerk):
            a = before * b[:-1] + after * b[1:]
            acceleration = max(acceleration, np.abs(a).max() / most)
            change = np.diff(np.concatenate([[0], a, [0]]))
            jerk = max(jerk, (np.abs(change) / at).max() / jerk_most)
        for before, after in self.tool_accelerations():
            a = before * b[:-1, None] + after * b[1:, None]
            acceleration = max(acceleration, np.linalg.norm(a, axis=1).max() / self.tool_limits[1])
            change = np.diff(np.concatenate([np.zeros((1, 3)), a, np.zeros((1, 3))]), axis=0)
            jerk = max(jerk, (np.linalg.norm(change, axis=1) / at).max() / self.tool_limits[2])
        return speed, acceleration, jerk

    def within(self, b):
        """The law slowed down evenly until it keeps all limits."""
        speed, acceleration, jerk = self.used(b)
        factor = max(speed, acceleration, jerk ** (2 / 3), 1e-12)
        return b / factor

    def rows(self, b):
        """The linear limits around a law: matrix and right side."""
        n = self.nodes
        data, row, column, right = [], [], [], []
        count = 0
        at_root = np.sqrt(np.maximum(b, 1e-12))
        total = at_root[1:] + at_root[:-1]
        slope = -2 * self.step / total**2
        times = 2 * self.step / total

        def add(factors, most):
            nonlocal count
            for index, factor in factors:
                data.append(factor)
                row.append(count)
                column.append(index)
            right.append(most)
            count += 1

        tops = self.tops()
        for step in range(n - 1):
            if np.isfinite(tops[step]):
                add([(step, 0.5), (step + 1, 0.5)], tops[step])

        def node_time(node):
            """The time at a node and its slope by the three b around it."""
            factors = {}
            value = 0.0
            steps = [s for s in (node - 1, node) if 0 <= s < n - 1]
            for s in steps:
                value += 0.5 * times[s]
                for end in (s, s + 1):
                    factors[end] = factors.get(end, 0.0) + 0.5 * slope[s] / (2 * at_root[end])
            return value, factors

        node_times = [node_time(node) for node in range(n)]

        def limit_channel(before, after, most, jerk_most):
            for step in range(n - 1):
                for sign in (1, -1):
                    add([(step, sign * before[step]), (step + 1, sign * after[step])], most)
            for node in range(n):
                change = {}
                if node > 0:
                    change[node - 1] = change.get(node - 1, 0) - before[node - 1]
                    change[node] = change.get(node, 0) - after[node - 1]
                if node < n - 1:
                    change[node] = change.get(node, 0) + before[node]
                    change[node + 1] = change.get(node + 1, 0) + after[node]
                value, by = node_times[node]
                rest = value - sum(factor * b[index] for index, factor in by.items())
                for sign in (1, -1):
                    factors = {index: sign * factor / jerk_most for index, factor in change.items()}
                    for index, factor in by.items():
                        factors[index] = factors.get(index, 0.0) - factor
                    add(list(factors.items()), rest)

        for (before, after, most), jerk_most in zip(self.acceleration, self.jerk):
            limit_channel(before, after, most, jerk_most)
        for before, after in self.tool_accelerations():
            # The present direction of the acceleration, and its coordinates: a ball by its faces.
            a = before * b[:-1, None] + after * b[1:, None]
            size = np.linalg.norm(a, axis=1, keepdims=True)
            direction = np.where(size > 1e-9, a / np.maximum(size, 1e-9), 0.0)
            for i in range(3):
                if np.abs(before[:, i]).max() + np.abs(after[:, i]).max() > 1e-12:
                    limit_channel(before[:, i], after[:, i], self.tool_limits[1], self.tool_limits[2])
            for step in range(n - 1):
                add(
                    [(step, direction[step] @ before[step]), (step + 1, direction[step] @ after[step])],
                    self.tool_limits[1],
                )
        return coo_matrix((data, (row, column)), shape=(count, n)).tocsr(), np.array(right)

    def solve(self):
        # The parameter is the time of a law that keeps the limits: its b is 1.
        b = self.within(np.ones(self.nodes))
        best, least = b, self.times(b).sum()
        trust = 0.6
        for _ in range(ROUNDS):
            matrix, right = self.rows(b)
            root = np.sqrt(np.maximum(b, 1e-12))
            total = root[1:] + root[:-1]
            gradient = np.zeros(self.nodes)
            for end in (slice(0, -1), slice(1, None)):
                gradient[end] += -2 * self.step / total**2 / (2 * root[end])
            bounds = list(zip(b * (1 - trust) ** 2, b * (1 + trust) ** 2))
            found = linprog(gradient, A_ub=matrix, b_ub=right, bounds=bounds, method="highs")
            if not found.success:
                trust /= 2
                continue
            law = self.within(found.x)
            time = self.times(law).sum()
            if time < least:
                gain = 1 - time / least
                best, least, b = law, time, law
                if gain < MARGIN and trust < 0.1:
                    break
            else:
                trust /= 2.5
                if trust < 0.01:
                    break
        return least


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    ratios = defaultdict(list)
    others = defaultdict(list)
    with open(sys.argv[1], encoding="utf-8") as file:
        for line in file:
            path = json.loads(line)
            least = Program(path).solve()
            ratios[path["name"]].append(path["took"] / least)
            others[path["name"]].append(path["least"] / least)
    failed = False
    for name, values in ratios.items():
        worst = max(values)
        print(
            f"{name:30} {len(values):4}  mean {sum(values) / len(values):.3f}  worst {worst:.3f}"
            f"  (the barrier's reference: {min(others[name]):.3f} to {max(others[name]):.3f} of this one)"
        )
        if len(sys.argv) > 3:
            is_singular = "shoulder" in name or "wrist" in name
            failed |= worst > float(sys.argv[2 if is_singular else 3])
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
