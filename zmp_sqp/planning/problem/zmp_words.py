"""Words for a zero moment point (ZMP) outside the support polygon, or too close to an edge."""

from __future__ import annotations

from zmp_sqp.arrays import distinct_texts, length_text
from zmp_sqp.mechanics.support import SupportPolygon
from zmp_sqp.planning.constraints.tip_over import edge_label

__all__ = ["edge_text", "zmp_position"]


def edge_text(support: SupportPolygon, index: int) -> str:
    """Edge in a sentence: "the left edge" on a rectangle, "edge 3" on any other polygon."""
    label = edge_label(support, index)
    return label if label.startswith("edge") else f"the {label}"


def zmp_position(
    support: SupportPolygon, edge: int, *, distance: float, margin: float, modal: str = ""
) -> str:
    """Words that follow "the ZMP" where it violates the margin: outside, or inside but too close.

    Args:
        support: The support polygon.
        edge: Index of the edge with the least distance.
        distance: Signed distance from that edge to the ZMP, positive inside [m].
        margin: Required distance, larger than `distance` [m].
        modal: "would" or "may" for a ZMP that is not certainly there.
    """
    lies, be = (f"{modal} lie", f"{modal} be") if modal else ("lies", "is")
    named = edge_text(support, edge)
    if distance < 0.0:
        required = f" (required margin: {margin:.10g} m)" if margin else ""
        return f"{lies} {length_text(-distance)} outside {named} of the support polygon{required}"
    shown, _ = distinct_texts(distance, margin, digits=3)
    return (
        f"{be} inside the support polygon, but only {shown} m from {named}, "
        f"{length_text(margin - distance)} short of the margin of {margin:.10g} m"
    )
