#!/usr/bin/env python3
"""Writes _volume.pyi, so that type checkers know the keywords of isonest.isosurface.

isonest.isosurface passes all keywords that it does not name itself to Store.isosurface. Their names, types and defaults
are written once, in _extracting.py; the stub contains them twice, for one isovalue and for several.

usage: make_stub.py PACKAGE OUTPUT
"""
import ast
import pathlib
import sys


def module(folder, name):
    return ast.parse((folder / name).read_text(encoding="utf-8"))


def functions(body, name):
    return [node for node in body if isinstance(node, ast.FunctionDef) and node.name == name]


def overloads(folder):
    """The overloads of Store.isosurface."""
    extracting = next(node for node in module(folder, "_extracting.py").body if isinstance(node, ast.ClassDef))
    return [f for f in functions(extracting.body, "isosurface") if f.decorator_list]


def stub_of(function, like=None):
    """The signature; `like`: an overload with the types of isovalue and result, and the keywords of `**query`."""
    arguments = function.args
    if like is not None:
        own = {a.arg for a in arguments.kwonlyargs}
        more = [(a, d) for a, d in zip(like.args.kwonlyargs, like.args.kw_defaults) if a.arg not in own]
        iso = like.args.args[1].annotation
        one = ast.unparse(iso) == "float"
        arguments = ast.arguments(
            posonlyargs=[], args=[arguments.args[0], ast.arg("iso", ast.parse("Optional[float]").body[0].value if one else iso)],
            defaults=[ast.Constant(None)] if one else [],
            kwonlyargs=arguments.kwonlyargs + [a for a, _ in more],
            kw_defaults=arguments.kw_defaults + [d for _, d in more])
    stub = ast.FunctionDef(name=function.name, args=arguments, body=[ast.Expr(ast.Constant(...))],
                           decorator_list=[] if like is None else [ast.Name("overload", ast.Load())],
                           returns=(like or function).returns, lineno=0)
    return ast.unparse(ast.fix_missing_locations(stub))


def main(folder, output):
    volume = module(folder, "_volume.py")
    lines = ["from typing import overload"]
    for source in (volume, module(folder, "_extracting.py")):
        for node in source.body:
            if isinstance(node, (ast.Import, ast.ImportFrom)) and getattr(node, "module", "") != "__future__":
                lines.append(ast.unparse(node))
            elif isinstance(node, ast.Assign):
                lines.append(ast.unparse(node))
    lines.append("from ._extracting import Extracting")
    for function in volume.body:
        if isinstance(function, ast.FunctionDef):
            likes = overloads(folder) if function.args.kwarg is not None else [None]
            lines += [stub_of(function, like) for like in likes]
    output.write_text("\n".join(lines) + "\n", encoding="utf-8")


main(pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2]))
