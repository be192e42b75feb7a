"""What notebooks, terminals and ``help`` show of scenes, plans, comparisons and records."""

import dataclasses
import inspect
import re
from html.parser import HTMLParser

import numpy as np
import pytest

import raytrace as rt
from raytrace.html_tables import Colour, html_table
from raytrace.image.comparison import MEANINGS
from raytrace.records import Lights
from raytrace.scene.display import MOST_ROWS

NASTY = "<script>alert(1)</script>\x1b[2J"
VOID = {"br", "img", "meta"}


class Reader(HTMLParser):
    """Checks that tags are closed, and keeps them and the text."""

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.text = [], set(), []
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attributes):
        self.tags.add(tag)
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


@pytest.fixture(scope="module")
def scene():
    return rt.load("scenes/cornell-box.json")


@pytest.fixture(scope="module")
def comparison():
    grey = np.full((16, 16, 3), 0.5)
    return rt.compare(1.25 * grey, grey, flip=False)


def test_scenes_plans_and_comparisons_are_one_short_line(scene, comparison):
    assert repr(scene) == (
        "<Scene cornell-box: 34 triangles in 7 objects, 3 materials, 1 point light; 512x512, 32 spp, direct>"
    )
    assert repr(rt.explain(scene)) == (
        "<Plan: 34 triangles in 7 objects, 3 materials, 1 point light; float32; 6 passes, 5 left out; print it>"
    )
    line = "<Comparison: rmse 0.125, rmse_srgb 0.07701, ssim 0.9951, worst_tile 0.25, outliers 1; print it>"
    assert repr(comparison) == line


def test_a_comparison_prints_each_number_with_its_meaning(comparison):
    lines = str(comparison).splitlines()
    assert [line.split()[0] for line in lines] == [name for name in MEANINGS if "flip" not in name]
    assert MEANINGS.keys() == set(comparison._fields)
    assert not re.search(r"\d\.\d{6}", str(comparison))
    broken = np.full((16, 16, 3), np.nan)
    assert "non_finite 256" in repr(rt.compare(broken, broken, flip=False))


def test_tables_in_html_have_the_same_numbers(scene, comparison):
    plan = rt.explain(scene)
    read = Reader(plan._repr_html_())
    assert {what for row in (*plan.passes, *plan.left_out) for what in row} <= set(read.text)
    assert {"rmse", "0.125", MEANINGS["ssim"]} <= set(Reader(comparison._repr_html_()).text)
    text = Reader(scene._repr_html_()).text
    assert {scene.about, "grey", "red", "green", "diffuse", "point at (0, 1.5, 0.5), flux 17, 12, 5 W"} <= set(text)


def test_tables_set_no_colours_but_those_of_materials(scene):
    html = scene._repr_html_() + rt.explain(scene)._repr_html_()
    assert html.count("background:") == len(scene.materials.name)
    assert not re.search(r"[^-]color:|<style|class=", html)  # a theme's own colours
    swatch = html_table("", (), [[Colour((1.0, 0.0, 0.2159))]])
    assert "background: rgb(255, 0, 128)" in swatch


def test_no_text_of_a_scene_becomes_markup(scene):
    names = (NASTY, *scene.materials.name[1:])
    bad = dataclasses.replace(
        scene,
        about=NASTY,
        warnings=(NASTY,),
        materials=scene.materials._replace(name=names),
        source=scene.source / NASTY,
    )
    for html in (bad._repr_html_(), rt.explain(bad)._repr_html_()):
        read = Reader(html)
        assert "script" not in read.tags
        assert "\x1b" not in html
        assert "<script>" in "".join(read.text)
    assert "\x1b" not in repr(bad)


def test_long_scenes_have_short_tables(scene):
    many = 3 * MOST_ROWS
    lights = Lights(np.zeros((many, 3)), np.ones((many, 3)))
    names = tuple(f"m{k}" for k in range(many))
    table = [np.repeat(column[:1], many, axis=0) for column in scene.materials[1:6]]
    big = dataclasses.replace(scene, lights=lights, materials=type(scene.materials)(names, *table))
    html = big._repr_html_()
    assert html.count("<tr>") < 2 * MOST_ROWS + 15
    assert html.count(f"and {many - MOST_ROWS} more") == 2


@pytest.mark.parametrize("name", ["metals", "sky", "lens", "textures", "glass-sphere"])
def test_every_kind_of_scene_has_tables(name):
    scene = rt.load(f"scenes/{name}.json")
    read = Reader(scene._repr_html_())
    assert set(scene.materials.name) <= set(read.text)
    assert len(repr(scene)) < 200


def test_records_of_arrays_show_types_and_shapes_but_few_numbers_in_full(scene):
    hits = rt.Hits(*(np.zeros((480, 640), kind) for kind in ("f4", "i4", "f4", "f4")))
    assert repr(hits) == (
        "Hits(t=<float32 (480, 640)>, prim_id=<int32 (480, 640)>, u=<float32 (480, 640)>, v=<float32 (480, 640)>)"
    )
    assert repr(scene.camera).startswith("Camera(position=array([0. , 1. , 6.8]), look_at=array([0., 1., 0.]), up=")
    for record in (scene.mesh, scene.materials, scene.lights, rt.AllHits(*[np.zeros(99)] * 5)):
        assert len(repr(record)) < 400
        assert "\n" not in repr(record)
    assert eval(repr(hits._replace(t=1)).partition(",")[0] + ")", {"Hits": dict}) == {"t": 1}


# Signatures -----------------------------------------------------------------------------------------------------------


def public(module, prefix):
    """Name and value of all that ``help`` shows: public names, their methods, and those of public packages."""
    for name in getattr(module, "__all__", ("eval", "pdf", "sample")):
        value = getattr(module, name)
        if inspect.ismodule(value):
            yield from public(value, f"{prefix}{name}.")
            continue
        yield prefix + name, value
        for base in inspect.getmro(value) if inspect.isclass(value) else ():
            if base.__module__.startswith("raytrace"):
                for key, member in vars(base).items():
                    if inspect.isfunction(member) and (key == "__init__" or not key.startswith("_")):
                        yield f"{prefix}{name}.{key}", member


def test_signatures_are_as_they_are_written():
    import raytrace.adapters.trimesh
    import raytrace.golden.check

    found = dict(public(rt, "rt."))
    found |= {"Intersector": raytrace.adapters.trimesh.RayMeshIntersector, "check": raytrace.golden.check.Golden.check}
    assert len(found) > 90
    for name, value in found.items():
        if inspect.isclass(value) and issubclass(value, Exception):
            continue
        for parameter in inspect.signature(value).parameters.values():
            text = str(parameter)
            assert len(text) <= 100, f"{name}: {text}"
            assert not re.search(r"Union\[|numpy\.|typing\.|ForwardRef|raytrace\.", text), f"{name}: {text}"


def test_a_class_of_arrays_is_helped_with_in_short_lines():
    import pydoc

    text = pydoc.plain(pydoc.render_doc(rt.BVH)) + pydoc.plain(pydoc.render_doc(rt.Hits))
    assert "Union[" not in text
    assert "numpy._typing" not in text
    assert "vertices: 'ArrayLike | MeshLike'" in text or "vertices: ArrayLike | MeshLike" in text  # from Python 3.14 on
