"""The drawing of a path: its tables, its data, and the two ways of looking at the scene around it."""

import re
from html.parser import HTMLParser

import numpy as np
import pytest

import raytrace as rt
from raytrace.records import Mesh
from raytrace.show.mesh_outline import feature_lines
from raytrace.show.path_section import Plane, cut
from raytrace.show.path_tables import tables_of
from small_scenes import Part, ball, box, look, make_scene, studio


@pytest.fixture(scope="module")
def drawing():
    return rt.show.path("scenes/cornell-box-glass.json", (24, 24), size=(64, 64))


def test_the_data_are_the_steps(drawing):
    assert [step.event for step in drawing.steps.path] == ["enters", "lands"]
    for name in ("o", "d", "p", "ns", "t", "angle_in", "eta"):
        np.testing.assert_array_equal(drawing.data[name], [getattr(step, name) for step in drawing.steps.path])
    np.testing.assert_array_equal(drawing.data["radiance"], drawing.steps.radiance)
    np.testing.assert_array_equal(drawing.data["shadow_d"], [ray.d for ray in drawing.steps.shadows])


def test_the_printed_tables_hold_the_numbers(drawing):
    text, (first, second) = str(drawing), drawing.steps.path
    lines = [line for line in text.splitlines() if re.match(r"[12] ", line)]
    assert "enters" in lines[0]
    assert " ".join(f"{x:.4f}" for x in first.p) in lines[0]
    assert f"{first.angle_in:.2f}" in lines[0]
    assert f"{first.angle_out:.2f}" in lines[0]
    assert f"{second.t:.5g}" in lines[1]
    assert " ".join(f"{x:.6f}" for x in drawing.steps.radiance) in text
    assert "-0.0000 " not in text
    assert "nan" not in text


def test_the_page_of_a_notebook_is_well_formed_and_whole(drawing):
    class Reader(HTMLParser):
        open, cells = (), 0

        def handle_starttag(self, tag, attributes):
            self.cells += tag == "td"
            if tag != "img":
                self.open = (*self.open, tag)
            assert all(not value.startswith("http") for name, value in attributes if name == "src")

        def handle_endtag(self, tag):
            assert self.open[-1] == tag
            self.open = self.open[:-1]

    reader = Reader()
    reader.feed(drawing._repr_html_())
    assert reader.open == ()
    assert reader.cells == sum(len(row) for table in tables_of(drawing.steps) for row in table.rows)


def test_rays_are_drawn_from_the_camera_to_where_they_hit(drawing):
    side = next(axes for axes in drawing.figure.axes if axes.get_title(loc="left") == "from the side")
    first = next(line for line in side.lines if line.get_linewidth() == 2.4).get_xydata()
    hit = drawing.steps.path[0].p
    np.testing.assert_allclose(first, [[0, 0], [6.8 - hit[2], hit[1] - 1]], atol=1e-5)  # away from the camera, up


def test_a_path_that_meets_nothing_can_be_drawn():
    drawing = rt.show.path(make_scene([Part(box((-1, -1, -1), (1, 1, 1)))], camera=look((0, 0, 5), (0, 9, 0))), (1, 1))
    assert "leaves the scene" in str(drawing)
    assert drawing._repr_png_()


def test_every_sample_of_the_studio_can_be_drawn():
    for pixel in ((24, 24), (30, 33), (2, 45)):
        assert rt.show.path(studio(), pixel, sample=3).encode("svg")


# --- lines of the scene ----------------------------------------------------------------------------------------------


def mesh_of(triangles):
    return make_scene([Part(triangles)]).mesh


def test_a_box_has_twelve_wires_and_no_diagonal():
    lines = feature_lines(mesh_of(box((0, 0, 0), (1, 2, 3))), np.array([0.3, 0.5, 0.8]))
    assert sorted(np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1).round(6).tolist()) == [1] * 4 + [2] * 4 + [3] * 4


def test_objects_that_touch_share_their_corners_and_an_open_mesh_shows_its_boundary():
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    mesh = Mesh(corners, np.array([[0, 1, 2], [3, 4, 5]]), None, np.zeros(2, np.int32), np.zeros(2, np.int32))
    assert len(feature_lines(mesh, np.array([0.0, 0.0, 1.0]))) == 4


def test_a_smooth_ball_shows_its_outline():
    triangles, _ = ball(16)
    lines = feature_lines(mesh_of(triangles), np.array([0.0, 1.0, 0.0]))
    assert len(lines) == 32  # once around, at the equator
    assert np.abs(lines[..., 1]).max() < 0.1
    np.testing.assert_allclose(np.linalg.norm(lines, axis=2), 1)


def test_a_plane_cuts_a_ball_in_a_circle():
    triangles, _ = ball(64)
    step = rt.show.path(make_scene([Part(triangles)], camera=look((0.0, 0.3, 5), (0, 0.3, 0))), (4, 4)).steps.path[0]
    plane = Plane(step, np.array([0.0, 1.0, 0.0]))
    np.testing.assert_allclose(plane.frame @ plane.frame.T, np.eye(3), atol=1e-12)
    lines = cut(mesh_of(triangles), plane)
    centre = plane.coordinates(np.zeros(3))
    radius = np.linalg.norm(lines - centre[:2], axis=-1)
    np.testing.assert_allclose(radius, np.sqrt(1 - centre[2] ** 2), atol=3e-3)
    assert len(lines) > 100
