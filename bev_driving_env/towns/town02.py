"""CARLA's Town02 as a table; lane centres lie within 0.5 m of CARLA's everywhere.

Figures were read from the public OpenDRIVE file of 2020-07-29 (RoadRunner 2019.2.12). One turn is
wider than its junction's others and has a radius of its own; B3's half size fits the other three.
"""

from __future__ import annotations

from .grid import GridTown

TOWN02 = GridTown(
    columns={"A": -5.4, "B": 43.85, "C": 134.15, "D": 191.7},
    rows={"1": 107.4, "2": 189.6, "3": 238.9, "4": 304.55},
    links="""
        A1-D1 A2-B2 B2-C2 C2-D2 B3-C3 C3-D3 A4-B4 B4-D4
        A1-A2 A2-A4 B2-B3 B3-B4 C2-C3 D1-D2 D2-D3 D3-D4
    """,
    junctions="""
        A2  6.6  N  8.3 -10.1,177.6  E  8.9 7.2,185.0    S  9.7 -0.8,202.8
        B2  7.3  E  8.9 58.4,185.3   S  9.6 48.5,203.6   W  9.2 30.6,194.3
        B3  6.6  N 11.3 39.3,226.8   E 10.9 56.6,234.2   S  9.0 48.5,252.1
        B4  5.8  N  8.6 39.1,289.2   E  8.8 57.0,300.0   W  9.2 31.7,309.4
        C2  6.8  E 10.9 146.3,184.8  S  9.6 138.9,202.1  W 11.0 121.0,194.1
        C3  6.4  N  8.8 129.6,226.2  E  8.9 147.4,234.2  W  9.1 122.2,243.8
        D2  6.2  N  8.5 186.9,176.4  S  9.4 196.2,201.7  W  9.2 178.9,194.3
        D3  6.9  N  8.6 186.9,225.9  S  9.4 196.2,251.1  W  9.2 178.9,243.7
    """,
    corners="A1 9.6  A4 8.4  D1 10.1  D4 10.3",
    wide_turns={"B3 N>E": 12.9},
)
