"""How far a blended aileron is from a rigid one, in NumPy.

python docs/examples/rigid.py fighter.su2
"""

import sys

import numpy as np

import sdm_deflect

ANGLE, FIRST, SECOND = -12.0, np.array([0.69180885, -0.3048, 0.0]), np.array([0.676698453, -0.1162672, 0.0])
# Triangles of the skin that are tried for each node, and points along each of their edges.
NEAR, SHARES = 12, 201


def turned(points: np.ndarray) -> np.ndarray:
    """Return points (N, 3) turned about the hinge, by Rodrigues' formula."""
    axis, arm, angle = (SECOND - FIRST) / np.linalg.norm(SECOND - FIRST), points - FIRST, np.radians(ANGLE)
    along = np.outer(arm @ axis, axis)
    return FIRST + along + np.cos(angle) * (arm - along) + np.sin(angle) * np.cross(axis, arm)


def distance(point: np.ndarray, corners: np.ndarray) -> float:
    """Return the distance of a point from a triangle (3, 3): from the nearest of many points on it."""
    s, t = np.meshgrid(*2 * [np.linspace(0.0, 1.0, SHARES)])
    s, t = (share[s + t <= 1.0][:, None] for share in (s, t))
    a, b, c = corners
    return float(np.linalg.norm(a + s * (b - a) + t * (c - a) - point, axis=1).min())


def main(path: str) -> tuple[np.ndarray, float]:
    """Return the node that is farthest from the rigid skin, and its distance."""
    mesh = sdm_deflect.read(path)
    blended = sdm_deflect.deflect(mesh, "aileron_left", [FIRST, SECOND], ANGLE, motion="blended", fixed="wing_left")
    nodes, (faces,) = mesh.on("aileron_left"), mesh.patch("aileron_left").faces
    rigid = turned(mesh.points)[faces.nodes]  # (F, 3, 3): corners of the triangles
    far = []
    for point in blended.points[nodes]:
        order = np.argsort(np.linalg.norm(rigid.mean(axis=1) - point, axis=1))
        far.append(min(distance(point, rigid[i]) for i in order[:NEAR]))
    return mesh.points[nodes[np.argmax(far)]], max(far)


if __name__ == "__main__":
    node, farthest = main(sys.argv[1])
    print(f"{1e3 * farthest:.2f} mm, at the node {node}")
