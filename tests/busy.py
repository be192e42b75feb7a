"""Tests that use time, signals, processes, threads or locks, which a busy machine may disturb, are marked ``busy``.

A test is busy if its code has one of the words below, or uses a function, class or fixture of its file, or of a module
beside it, whose code has one. ``pytest -m busy`` runs these tests, and ``pytest -m busy --collect-only -q`` lists them.
"""

import ast
import functools
import re
from pathlib import Path

FOLDER = Path(__file__).parent
WORDS = re.compile(
    r"\btime\.(sleep|time|perf_counter|monotonic|process_time)\b|\btime_limit=|\bsleep\(|\btimeout=|\bsignal\.|\bSIG[A-Z]+\b"
    r"|\bsubprocess\b|\bPopen\b|\bmultiprocessing\b|\bos\.(fork|kill|killpg|waitpid|pipe)\b|\bpty\.|\brunpytest"
    r"|\bthreading\b|\bThread(PoolExecutor)?\(|\b(R?Lock|Event|Barrier|Condition|Semaphore)\(|\bflock\b|\bfcntl\b|\bLocalCluster\b"
    r"|\bPool\(|\bworkers\.compile_all\b|\binterrupt_kernel\b|\bKeyboardInterrupt\b|\bsync_playwright\b"
)


def busy_names(source: str, more: dict[str, frozenset[str]] | None = None) -> frozenset[str]:
    """Names of the functions and classes of a file that are busy; of a class's methods, as ``Class.method`` too.

    Parameters
    ----------
    source : str
    more : dict
        Busy names of modules that the file may import names from.
    """
    tree = ast.parse(source)
    known = {alias.asname or alias.name
             for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)
             for alias in node.names if alias.name in (more or {}).get(node.module or "", ())}  # fmt: skip
    parts: dict[str, str] = {}
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            parts[node.name] = _code(source, node)
        elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):  # a program as a text, say
            parts[node.targets[0].id] = _code(source, node)
    names = {name: set(re.findall(r"\w+", code)) for name, code in parts.items()}
    busy = {name for name, code in parts.items() if WORDS.search(code)}
    while True:
        found = {name for name, used in names.items() if name not in busy and used & (busy | known)}
        if not found:
            return frozenset(busy | known)
        busy |= found


def _code(source: str, node: ast.stmt) -> str:
    """The text of a statement with its decorators, without comments and docstring."""
    begin = min([node.lineno, *(d.lineno for d in getattr(node, "decorator_list", []))])
    lines = source.splitlines()[begin - 1 : node.end_lineno]
    text = "\n".join(re.sub(r"(^|\s)# .*$", "", line) for line in lines)
    docstring = ast.get_docstring(node, clean=False) if isinstance(node, ast.FunctionDef | ast.ClassDef) else None
    return text.replace(docstring, "", 1) if docstring else text


@functools.cache
def busy_in(path: Path) -> frozenset[str]:
    """Busy names of a file, those of the modules beside it that it imports from included."""
    source = path.read_text("utf-8")
    modules = {node.module for node in ast.walk(ast.parse(source)) if isinstance(node, ast.ImportFrom) and node.module}
    beside = {name: FOLDER / f"{name}.py" for name in modules if (FOLDER / f"{name}.py").is_file()}
    return busy_names(source, {name: busy_in(file) for name, file in beside.items() if file != path})
