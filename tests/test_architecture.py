"""The rules of the house, as tests. An exception is a row in a table here, with its reason."""

import ast
import importlib
import inspect
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import raytrace

PACKAGE = Path(__file__).parent.parent / "raytrace"
ROOT = PACKAGE.parent
FILES = sorted(path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py"))
TREES = {name: ast.parse((PACKAGE / name).read_text("utf-8")) for name in FILES}

MAX_FILE = 300  # lines
MAX_BODY = 40  # lines, without the docstring
MAX_ARGUMENTS = 6  # that may be given by position

# "file" or "file:function" -> why it may be longer, or take more
LONG_FILES: dict[str, str] = {}
LONG_BODIES: dict[str, str] = {}
RECORDS = "a kernel takes its records one by one: their types decide what is compiled"
TRAVERSAL = "a traversal of its records, with the place of its rays and the test that they are given"
MANY_ARGUMENTS: dict[str, str] = {
    "accel/all_hits.py:test_packet": TRAVERSAL,
    "accel/all_hits.py:all_single": TRAVERSAL,
    "accel/all_hits.py:all_of_rays": TRAVERSAL,
    "accel/all_hits.py:trace_all": TRAVERSAL,
    "passes/lights.py:pick_lights": RECORDS,
    "passes/lights.py:sample_triangles": RECORDS,
    "passes/lights.py:sample_environment": RECORDS,
    "passes/materials.py:scatter_diffuse": RECORDS,
    "passes/rough.py:scatter_conductors": RECORDS,
    "passes/rough.py:scatter_dielectrics": RECORDS,
    "passes/plastic.py:scatter_plastic": RECORDS,
    "passes/environment.py:sample_image": RECORDS,
    "passes/lens.py:lens_rays": RECORDS,
    "passes/materials.py:send": "all that a material says of how a path goes on",
}

NUMBA = (  # the compiler, and the type that it is taught
    "accel/lanes_block_jit.py",
    "accel/lanes_pool_jit.py",
    "accel/lanes_jit.py",
    "accel/lanes_types.py",
    "compiled.py",
    "native/c_entry.py",
    "native/caller.py",
    "native/compiled_rays.py",
    "native/library.py",
    "native/pipeline.py",
    "native/compiler.py",
    "native/entry.py",
    "native/plain.py",
)

DRAWN_IN_TURN = (
    "textbook/camera.py",
    "textbook/integrator.py",
)  # as books do; every other random number has an address

# package -> the packages that it may not import, so that data flows one way
LAYERS = {
    "textbook": ("accel", "passes", "native", "image", "rendering", "hardcases", "reporting", "show", "golden", "cli"),
    "scene": ("textbook", "accel", "passes", "rendering", "hardcases", "reporting", "show", "golden", "cli"),
    "native": ("textbook", "scene", "passes", "image", "rendering", "hardcases", "reporting", "show", "golden", "cli"),
    "accel": ("textbook", "scene", "passes", "image", "rendering", "hardcases", "reporting", "show", "golden", "cli"),
    "passes": ("textbook", "scene", "image", "rendering", "hardcases", "reporting", "show", "golden", "cli"),
    "image": ("textbook", "scene", "accel", "passes", "rendering", "hardcases", "reporting", "show", "golden", "cli"),
    "hardcases": ("textbook", "scene", "image", "rendering", "reporting", "show", "golden", "cli"),
    "golden": ("textbook", "scene", "accel", "passes", "rendering", "hardcases", "reporting", "show", "cli"),
    "rendering": ("textbook", "hardcases", "reporting", "show", "golden", "cli"),
    "reporting": ("show", "golden", "cli"),  # it measures the textbook where it is asked to
    "exporting": ("textbook", "accel", "passes", "rendering", "hardcases", "reporting", "show", "golden", "cli"),
    "show": ("textbook", "golden", "cli"),
    "testing": ("textbook", "image", "hardcases", "reporting", "show", "golden", "cli"),
    "conformance": ("textbook", "hardcases", "reporting", "show", "golden", "cli"),
    "cli": ("textbook", "golden"),
    "adapters": ("textbook", "scene", "passes", "rendering", "hardcases", "reporting", "show", "golden", "cli"),
}


def functions(tree: ast.AST) -> Iterator[ast.FunctionDef]:
    return (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef))


def body_lines(function: ast.FunctionDef) -> int:
    first = function.body[ast.get_docstring(function, clean=False) is not None :]
    return function.end_lineno - first[0].lineno + 1 if first else 0


def imports(tree: ast.AST) -> Iterator[str]:
    """Dotted names of all that is imported, wherever the statement stands."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{name.name}" for name in node.names)


def within(name: str, package: str) -> bool:
    return name == package or name.startswith(f"{package}.")


@pytest.mark.parametrize("name", FILES)
def test_a_file_is_short(name):
    lines = (PACKAGE / name).read_text("utf-8").count("\n")
    assert lines <= MAX_FILE or name in LONG_FILES, f"{name} has {lines} lines: make two nouns of it"


@pytest.mark.parametrize("name", FILES)
def test_a_function_is_short(name):
    long = {function.name: body_lines(function) for function in functions(TREES[name])}
    long = {f: n for f, n in long.items() if n > MAX_BODY and f"{name}:{f}" not in LONG_BODIES}
    assert not long, f"{name}: bodies of more than {MAX_BODY} lines"


@pytest.mark.parametrize("name", FILES)
def test_a_function_takes_few_arguments(name):
    many = {}
    for function in functions(TREES[name]):
        positional = [arg.arg for arg in (*function.args.posonlyargs, *function.args.args)]
        count = len(positional) - (positional[:1] in (["self"], ["cls"]))
        if count > MAX_ARGUMENTS and f"{name}:{function.name}" not in MANY_ARGUMENTS:
            many[function.name] = count
    assert not many, f"{name}: pass a record instead"


@pytest.mark.parametrize("name", [name for name in FILES if name.split("/")[0] in LAYERS])
def test_data_flows_one_way(name):
    forbidden = [f"raytrace.{other}" for other in LAYERS[name.split("/")[0]]]
    found = [used for used in imports(TREES[name]) if any(within(used, package) for package in forbidden)]
    assert not found, f"{name} imports what comes after it"


def test_every_package_has_a_layer():
    packages = {name.split("/")[0] for name in FILES if "/" in name}
    assert packages == LAYERS.keys()
    assert {other for others in LAYERS.values() for other in others} <= packages


def module_imports(name: str) -> set[str]:
    """Modules of the package that a file imports at its top level, as paths of files."""
    found = set()
    for node in TREES[name].body:
        for used in imports(node) if isinstance(node, ast.Import | ast.ImportFrom) else ():
            parts = used.split(".")[1:]
            for n in range(len(parts), 0, -1):
                if f"{'/'.join(parts[:n])}.py" in FILES:
                    found.add(f"{'/'.join(parts[:n])}.py")
                    break
    return found


def test_no_modules_import_each_other_in_a_circle():
    below: dict[str, set[str]] = {name: module_imports(name) for name in FILES}
    left = set(FILES)
    while leaves := {name for name in left if not below[name] & left}:
        left -= leaves
    assert not left, "these import each other, directly or by way of others"


@pytest.mark.parametrize("package", sorted({name.split("/")[0] for name in FILES if "/" in name}))
def test_no_module_has_the_name_of_a_public_function(package):
    """An imported submodule becomes an attribute of its package, and would hide the function."""
    public = set(getattr(importlib.import_module(f"raytrace.{package}"), "__all__", ()))
    assert not public & {Path(name).stem for name in FILES if name.startswith(f"{package}/")}


@pytest.mark.parametrize("name", [name for name in FILES if name not in NUMBA])
def test_only_the_compiler_knows_numba(name):
    found = [used for used in imports(TREES[name]) if within(used, "numba")]
    assert not found, f"{name}: take the decorators from raytrace.jit"


@pytest.mark.parametrize("name", [name for name in FILES if name not in ("native/compiler.py", "native/plain.py")])
def test_only_the_compiler_and_its_fallback_compile(name):
    words = {node.id for node in ast.walk(TREES[name]) if isinstance(node, ast.Name)}
    words |= {node.attr for node in ast.walk(TREES[name]) if isinstance(node, ast.Attribute)}
    assert not words & {"njit", "jit", "vectorize", "guvectorize", "prange", "jitclass"}


@pytest.mark.parametrize("name", FILES)
def test_nothing_prints_but_through_streams(name):
    calls = [node.lineno for node in ast.walk(TREES[name]) if isinstance(node, ast.Name) and node.id == "print"]
    assert not calls, f"{name}: return text, or use raytrace.cli.streams"


@pytest.mark.parametrize("name", [name for name in FILES if name not in DRAWN_IN_TURN])
def test_random_numbers_have_addresses(name):
    used = set(imports(TREES[name]))
    used |= {ast.unparse(node) for node in ast.walk(TREES[name]) if isinstance(node, ast.Attribute)}
    found = [word for word in used if any(within(word, source) for source in ("np.random", "numpy.random", "random"))]
    assert not found, f"{name}: use raytrace.passes.sampling"


@pytest.mark.parametrize("name", FILES)
def test_no_error_is_swallowed(name):
    for handler in (node for node in ast.walk(TREES[name]) if isinstance(node, ast.ExceptHandler)):
        broad = handler.type is None or ast.unparse(handler.type) in ("Exception", "BaseException")
        empty = all(isinstance(statement, ast.Pass | ast.Continue) for statement in handler.body)
        assert not (broad and empty), f"{name}:{handler.lineno}"


def test_every_exception_to_a_rule_is_still_needed():
    bodies = {f"{name}:{f.name}": body_lines(f) for name, tree in TREES.items() for f in functions(tree)}
    assert set(LONG_FILES) <= {name for name in FILES if (PACKAGE / name).read_text("utf-8").count("\n") > MAX_FILE}
    assert set(LONG_BODIES) <= {name for name, lines in bodies.items() if lines > MAX_BODY}
    assert set(MANY_ARGUMENTS) <= bodies.keys()
    assert set(NUMBA) <= set(FILES)


def test_the_rules_catch_what_they_forbid():
    tree = ast.parse('def f():\n    "Doc."\n' + "    x = 1\n" * (MAX_BODY + 1) + "from numba import njit\n")
    assert body_lines(next(functions(tree))) == MAX_BODY + 1
    assert list(imports(tree)) == ["numba.njit"]
    assert within("numba.njit", "numba")
    assert not within("numbers", "numba")


def test_the_changelog_knows_the_version():
    release, _, development = raytrace.__version__.partition(".dev")
    section = "Unreleased" if development else release
    assert f"## [{section}]" in (ROOT / "CHANGELOG.md").read_text("utf-8")


@pytest.mark.parametrize("name", raytrace.__all__)
def test_every_public_name_is_documented(name):
    thing = getattr(raytrace, name)
    if inspect.ismodule(thing) or isinstance(thing, str):
        return
    assert inspect.getdoc(thing), f"{name} has no docstring"
    record = inspect.isclass(thing) and (
        issubclass(thing, tuple | BaseException) or hasattr(thing, "__dataclass_fields__")
    )
    if not record:  # what a user calls comes with an example that the tests run
        assert ">>>" in inspect.getdoc(thing), f"{name} has no example"


@pytest.mark.parametrize("first", ["raytrace.rendering.rendering", "raytrace.image.metrics", "raytrace.scene.load"])
def test_public_functions_stay_functions_whatever_is_imported_first(first):
    program = f"import {first}, raytrace as rt; assert all(map(callable, (rt.load, rt.render, rt.explain, rt.compare)))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=600, cwd=ROOT)
    assert done.returncode == 0, done.stderr


def test_no_message_names_an_extra_of_a_package_that_no_index_has():
    found = [name for name in FILES if "raytrace[" in (PACKAGE / name).read_text("utf-8")]
    assert not found, "name the packages to install"


@pytest.mark.parametrize("name", FILES)
def test_every_cited_source_is_listed(name):
    cited = re.findall(r"\[([A-Z][A-Za-z]+[0-9]{3,4})(?:, [^]]*)?\]", (PACKAGE / name).read_text("utf-8"))
    listed = re.findall(r"^- \*\*\[(\w+)\]", (ROOT / "docs" / "references.md").read_text("utf-8"), re.MULTILINE)
    assert set(cited) <= set(listed), f"{name}: add it to docs/references.md"


def test_the_package_holds_only_what_the_wheel_needs():
    others = [path.name for path in PACKAGE.rglob("*") if path.is_file() and "__pycache__" not in path.parts]
    assert {name for name in others if not name.endswith(".py")} == {
        *("demo.json", "ball.ply", "dark.ply", "knot.ply", "light.ply"),
        "py.typed",
        "scene.schema.json",
        "widget.css",
        "page.js",
        "widget.js",
    }
