"""Pictures of replays, headless."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import zmp_sqp as zs
from tests.simulation.test_replay import push
from zmp_sqp.simulation.pictures import draw_strip, draw_video
from zmp_sqp.simulation.shapes import machine_solids

pytestmark = pytest.mark.physics
image = pytest.importorskip("PIL.Image")


@pytest.fixture(scope="module")
def replays() -> dict[str, zs.Replay]:
    pytest.importorskip("mujoco")
    return {
        name: zs.replay(*push(a, 0.2), zs.Slope(roll=0.1), hold=0.3)
        for name, a in (("calm", 1.0), ("wild", 9.0))
    }


def test_a_strip_has_a_row_per_motion_and_shows_something(
    replays: dict[str, zs.Replay], tmp_path: Path
) -> None:
    path = tmp_path / "strip.png"
    try:
        draw_strip(replays, path, moments=3, width=120)
    except zs.MissingExtra as missing:
        pytest.skip(str(missing))
    picture = np.asarray(image.open(path).convert("RGB")).astype(float)
    assert picture.shape[1] == 3 * 120
    assert picture.std() > 10.0
    rows = np.split(picture, 2)
    assert np.abs(rows[0] - rows[1])[:, 240:].max() > 50.0  # at the end they stand differently


def test_a_video_has_a_frame_every_20th_of_a_second(
    replays: dict[str, zs.Replay], tmp_path: Path
) -> None:
    path = tmp_path / "video.gif"
    try:
        draw_video({"calm": replays["calm"]}, path, width=80)
    except zs.MissingExtra as missing:
        pytest.skip(str(missing))
    with image.open(path) as video:
        assert 2 <= video.n_frames <= 11  # GIF merges frames that are alike


def test_nothing_to_draw_is_refused(replays: dict[str, zs.Replay], tmp_path: Path) -> None:
    with pytest.raises(zs.ProblemError, match="at least one replay"):
        draw_strip({}, tmp_path / "strip.png")
    with pytest.raises(zs.ProblemError, match="at least one replay"):
        draw_video({}, tmp_path / "video.gif")
    with pytest.raises(zs.ProblemError, match="one moment"):
        draw_strip(replays, tmp_path / "strip.png", moments=0)


def test_a_missing_pillow_says_how_to_install_it(
    replays: dict[str, zs.Replay], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "PIL.Image", None)
    with pytest.raises(zs.MissingExtra, match=r"Pillow: pip install zmp-sqp\[sim\]"):
        draw_strip(replays, tmp_path / "strip.png")


def test_every_machine_has_something_to_draw() -> None:
    tree = zs.Payload(
        mass=4000.0, com=(0.0, 0.0, 3.3), frame="head", inertia=np.diag([21333.3, 21333.3, 125.0])
    )
    buncher = zs.load_machine("feller_buncher").with_payload(tree)
    *_, stem = machine_solids(buncher)
    assert stem.kind == "cylinder"
    # radius and half length of the tree that was asked for
    assert stem.size == pytest.approx((0.25, 4.0), rel=0.01)
    *_, point = machine_solids(buncher.with_point_masses())
    assert point.kind == "cylinder"
    assert point.size[1] == pytest.approx(3.3)  # from the head to as far beyond its centre of mass
    stranger = zs.load_machine("slewing_crane")
    assert {solid.joint for solid in machine_solids(stranger)} == {1, 2}


def test_a_machine_of_which_only_inertias_are_known_is_drawn_as_bars(tmp_path: Path) -> None:
    from tests.simulation.test_multibody import machines

    solids = machine_solids(machines(tmp_path)["odd"])
    assert {solid.joint for solid in solids} == {1, 2, 3, 4}
    assert "capsule" in {solid.kind for solid in solids}
