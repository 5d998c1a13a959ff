"""Page of a live view: the renderer of a report, sliders, and a script that asks for plans."""

from __future__ import annotations

import secrets
from html import escape
from importlib import resources
from pathlib import Path

from zmp_sqp.report.page import SCRIPTS, asset, embedded
from zmp_sqp.view.session import Session

__all__ = ["live_page"]


def live_page(session: Session, token: str, nonce: str, save_to: Path | None) -> str:
    """The page as HTML.

    Args:
        session: Session that it is for.
        token: What its requests must have.
        nonce: Marks the scripts and styles that the page's policy lets run.
        save_to: File to which it may save; None for downloads only.
    """
    subject = session.subject
    poses = {
        name: {
            f"pose.{joint}": subject.displayed(joint, value)
            for joint, value in zip(subject.machine.joint_names, q.tolist(), strict=True)
        }
        for name, q in subject.poses.items()
    }
    live = {
        "title": subject.title,
        "name": subject.path.stem,
        "controls": [control.fields() for control in subject.controls.values()],
        "poses": poses,
        "parts": session.parts,
        "moves": subject.moves,
        "token": token,
        "saves": None if save_to is None else str(save_to),
    }
    # what comes from files and users goes in last: it cannot be taken for one of the marks
    mark = secrets.token_hex(8)
    page = _own("live.html").replace("<!--", f"<!--{mark}").replace('nonce=""', f'nonce="{nonce}"')
    scripts = [asset(name) for name in SCRIPTS] + [_own("panel.js"), _own("live.js")]
    for place, content in (
        ("style", asset("style.css") + _own("live.css")),
        ("scripts", "\n".join(f'<script nonce="{nonce}">\n{text}\n</script>' for text in scripts)),
        ("name", escape(subject.path.name)),
        ("title", escape(subject.title)),
        ("live", embedded(live)),
    ):
        page = page.replace(f"<!--{mark} {place} -->", content)
    return page


def _own(name: str) -> str:
    """Text of a file of the folder `assets`."""
    return (resources.files(__package__) / "assets" / name).read_text(encoding="utf-8")
