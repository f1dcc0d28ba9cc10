#!/usr/bin/env python3
"""Writes _extracting.pyi and _volume.pyi, so that type checkers know the keywords and results of isosurface.

Both modules have a function isosurface that returns a mesh for one isovalue and a list for several, and
isonest.isosurface passes all keywords that it does not name itself to Store.isosurface. Names, types and defaults are
written once, in the signature of Store.isosurface; the stubs contain them for each function and each kind of result.

usage: make_stub.py PACKAGE OUTPUT_FOLDER
"""
import ast
import copy
import pathlib
import sys

# The types of iso=, of level=, its other name, and of the result. Only the argument that is not None may be left out,
# and only if it is a number.
KINDS = (("Optional[float]", "Optional[float]", "Mesh"), ("Sequence[float]", "None", "list[Mesh]"),
         ("None", "Sequence[float]", "list[Mesh]"))


def expression(text):
    return ast.parse(text, mode="eval").body


def module(folder, name):
    return ast.parse((folder / f"{name}.py").read_text(encoding="utf-8"))


def overloads(function, query):
    """The signatures of a function isosurface, with the keywords of `query` in place of its own `**query`."""
    for iso, level, result in KINDS:
        signature = copy.deepcopy(function)
        arguments = signature.args
        at = next(i for i, a in enumerate(arguments.args) if a.arg == "iso")
        by_name = next(i for i, a in enumerate(arguments.kwonlyargs) if a.arg == "level")
        arguments.args[at].annotation, arguments.kwonlyargs[by_name].annotation = expression(iso), expression(level)
        if iso == "Sequence[float]":
            arguments.defaults.pop()
        if level == "Sequence[float]":
            arguments.kw_defaults[by_name] = None
        if arguments.kwarg is not None:
            own = {a.arg for a in arguments.kwonlyargs}
            more = [(a, d) for a, d in zip(query.args.kwonlyargs, query.args.kw_defaults) if a.arg not in own]
            arguments.kwonlyargs += [a for a, _ in more]
            arguments.kw_defaults += [d for _, d in more]
            arguments.kwarg = None
        signature.returns = expression(result)
        signature.decorator_list = [expression("overload")]
        yield signature


def without_code(body, query):
    """Imports, assignments, and the signatures of functions and methods."""
    kept = []
    for node in body:
        if isinstance(node, ast.ClassDef):
            node.body = without_code(node.body, query)
            kept.append(node)
        elif isinstance(node, ast.FunctionDef):
            kept += list(overloads(node, query)) if node.name == "isosurface" else [node]
        elif isinstance(node, (ast.Assign, ast.AnnAssign, ast.Import)) or (
                isinstance(node, ast.ImportFrom) and node.module != "__future__"):
            kept.append(node)
    for node in kept:
        if isinstance(node, ast.FunctionDef):
            node.body = [ast.Expr(ast.Constant(...))]
    return kept


def main(folder, output):
    extracting, volume = module(folder, "_extracting"), module(folder, "_volume")
    extracting_class = next(node for node in extracting.body if isinstance(node, ast.ClassDef))
    query = copy.deepcopy(next(node for node in extracting_class.body if getattr(node, "name", "") == "isosurface"))
    extracting.body = without_code(extracting.body, query)
    # The types of the query's keywords are those that _extracting.py imports and defines.
    names = [copy.deepcopy(node) for node in extracting.body if not isinstance(node, ast.ClassDef)]
    own = without_code(volume.body, query)
    imported = {alias.name for node in own if isinstance(node, ast.ImportFrom) for alias in node.names}
    for node in names:
        if isinstance(node, ast.ImportFrom):
            node.names = [alias for alias in node.names if alias.name not in imported]
    own.insert(0, ast.ImportFrom("_extracting", [ast.alias(extracting_class.name)], 1))
    volume.body = [node for node in names if getattr(node, "names", True)] + own
    volume.body.sort(key=lambda node: not isinstance(node, (ast.Import, ast.ImportFrom)))
    for name, tree in (("_extracting", extracting), ("_volume", volume)):
        text = "from typing import overload\n" + ast.unparse(ast.fix_missing_locations(tree)) + "\n"
        (output / f"{name}.pyi").write_text(text, encoding="utf-8")


main(pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2]))
