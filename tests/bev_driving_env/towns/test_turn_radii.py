import math
import re

import numpy as np
import pytest

from bev_driving_env.towns.registry import compiled_town

# CARLA's own lane-centre radius of every turn, as measured: heading before -> heading after
MEASURED = {
    "Town01": """
        B1 (90.4, 0)       N->W L9.5, W->S L8.9, E->S R5.5, N->E R6.3
        B2 (90.4, 57.5)    S->E L10.3, W->S L10.3, N->E R5.2, W->N R6.6
        B3 (90.4, 131.45)  S->E L11.0, W->S L9.5, N->E R5.7, W->N R6.5
        B4 (90.4, 197.15)  S->E L10.0, W->S L11.1, N->E R6.5, W->N R6.0
        B5 (90.4, 328.6)   E->N L12.8, S->E L13.1, S->W R8.8, W->N R9.1
        C1 (156.05, 0)     N->W L9.7, W->S L9.3, E->S R5.1, N->E R5.3
        C2 (156.05, 57.5)  E->N L10.1, S->E L10.7, S->W R6.2, W->N R6.5
        D1 (336.8, 0)      N->W L10.4, W->S L9.9, E->S R5.9, N->E R5.6
        D2 (336.8, 57.5)   E->N L11.8, N->W L10.8, E->S R6.3, S->W R7.0
        D3 (336.8, 131.45) E->N L10.6, N->W L10.9, E->S R6.7, S->W R6.8
        D4 (336.8, 197.15) E->N L11.0, N->W L10.1, E->S R6.3, S->W R6.8
        D5 (336.8, 328.6)  E->N L10.2, S->E L10.9, S->W R6.7, W->N R7.1
    """,
    "Town02": """
        A2 (-5.4, 189.6)    S->E L7.6, W->S L9.4, N->E R5.5, W->N R3.9
        B2 (43.85, 189.6)   N->W L9.7, W->S L9.2, E->S R5.3, N->E R4.9
        B3 (43.85, 238.9)   S->E L12.9, W->S L8.6, N->E R4.7, W->N R4.4
        B4 (43.85, 304.55)  E->N L7.9, S->E L7.1, S->W R3.6, W->N R4.5
        C2 (134.15, 189.6)  N->W L8.8, W->S L8.7, E->S R4.8, N->E R5.0
        C3 (134.15, 238.9)  E->N L8.6, S->E L8.0, S->W R4.5, W->N R4.6
        D2 (191.7, 189.6)   E->N L7.1, N->W L9.3, E->S R5.1, S->W R3.4
        D3 (191.7, 238.9)   E->N L8.6, N->W L9.0, E->S R5.5, S->W R4.6
    """,
}
COMPASS = {"N": (0, -1), "E": (1, 0), "S": (0, 1), "W": (-1, 0)}
TURNS = [
    (town, *row.groups()[:3], before, after, letter, float(radius))
    for town, table in MEASURED.items()
    for row in re.finditer(r"(\w\d) \((.*?), (.*?)\)\s+(.*)", table)
    for before, after, letter, radius in re.findall(r"(.)->(.) ([LR])([\d.]+)", row.group(4))
]


def turn_points(town, center, before, after):
    """All lane-centre points of the passage between two headings at a junction."""
    for number, lane in enumerate(town.lanes):
        end = lane.points[-1]
        if math.dist(end[:2], center) > 16.0 or np.dot(end[2:], COMPASS[before]) < 0.99:
            continue
        if lane.in_junction or np.dot(end[:2] - center, COMPASS[before]) > 0.0:
            continue  # inside the junction, or already past it
        for following in town.successors[number]:
            chain = [town.lanes[following]]
            while chain[-1].in_junction:
                (k,) = town.successors[town.lanes.index(chain[-1])]
                chain.append(town.lanes[k])
            if np.dot(chain[-1].points[0, 2:], COMPASS[after]) > 0.99:
                return np.concatenate([part.points[:, :2] for part in chain[:-1]])
    raise AssertionError(f"no way from heading {before} to heading {after} at {center}")


@pytest.mark.parametrize(
    ("name", "node", "x", "y", "before", "after", "letter", "measured_m"),
    TURNS,
    ids=[f"{t[0]}-{t[1]}-{t[4]}{t[5]}" for t in TURNS],
)
def test_a_turn_lies_within_half_a_metre_of_carlas(
    name, node, x, y, before, after, letter, measured_m
):
    town, center = compiled_town(name), np.array([float(x), float(y)])
    v_in, v_out = np.array(COMPASS[before]), np.array(COMPASS[after])
    right_in, right_out = np.array([-v_in[1], v_in[0]]), np.array([-v_out[1], v_out[0]])
    # an arc tangent to both lanes stays radius * (sqrt 2 - 1) away from where they would meet
    meet = center + 2.0 * right_in * (abs(right_in @ v_out) > 0) + 2.0 * right_out
    points = turn_points(town, center, before, after)
    nearest = np.linalg.norm(points - meet, axis=1).min()
    assert abs(nearest - measured_m * (math.sqrt(2.0) - 1.0)) < 0.5
    turns_right = v_in[0] * v_out[1] - v_in[1] * v_out[0] > 0
    assert letter == ("R" if turns_right else "L")


def test_the_table_covers_every_turn():
    assert len(TURNS) == 4 * (12 + 8)
