"""The package has the options of the program: the same names, types, choices and defaults.

The program's table of options (`isonest --help --json`) gives the argument of each option and its type, or the reason
why there is none. A new option fails this test until the package has its argument, and vice versa.
"""
import functools
import inspect
import json
import os
import re
import subprocess
import typing

import pytest

import isonest
from isonest import Store, _arguments, _sources
from isonest._extracting import Extracting

COMMANDS = {
    "preprocess": [isonest.preprocess],
    "extract": [Store.isosurface, Store.label_surface, Store.label_surfaces, Store.interfaces, Store.graph, isonest.Mesh.save,
                isonest.open, _sources.of_volume],
    "slice": [Store.slice, Store.contours, isonest.Mesh.save, isonest.open, _sources.of_volume],
    "study": [Store.study, isonest.open],
    "smooth": [isonest.smooth, _sources.of_volume],
    "info": [Store.histogram, isonest.open, _sources.of_volume],
    "export": [Store.export, isonest.open],
    "check": [Store.check, isonest.open, _sources.of_volume],
    "view": [Store.view, isonest.open, _sources.of_volume],
}
COMMANDS_LEFT_OUT = {
    "make-volume": "NumPy makes arrays",
    "picture": "VTK and Matplotlib draw meshes",
    "publish": "sites are written by the program alone",
}
ONLY_HERE = {  # (function, argument): why the program has no such option
    ("*", "self"): "the store", ("*", "progress"): "the program draws a bar",
    ("*", "coordinates"): "files are in world coordinates", ("*", "scratch"): "the folder of the output",
    ("*", "reading"): "those of preprocess", ("preprocess", "volume"): "INPUT", ("smooth", "volume"): "INPUT",
    ("of_volume", "volume"): "INPUT", ("of_volume", "label_names"): "of preprocess", ("open", "path"): "STORE",
    ("of_volume", "labels"): "labels are not smoothed", ("of_volume", "identified"): "resume, of preprocess",
    ("save", "shift"): "over, of meshes of labels",
    ("isosurface", "gradient_direction"): "that of scikit-image", ("isosurface", "level"): "scikit-image's name of iso",
    ("slice", "offset"): "the fourth number of the plane",
    ("contours", "offset"): "the fourth number of the plane",
    ("slice", "vertex_values"): "so far for extract alone", ("slice", "quality"): "so far for extract alone",
    ("view", "height"): "of the frame in a notebook",
    ("view", "program"): "it is the program",
}
OTHER_MEANINGS = {  # (command, function, argument): why it is not the option of that name
    ("*", "of_volume", "memory"): "what is left of it", ("*", "open", "memory"): "of the store's cache",
    ("extract", "of_volume", "labels"): "whether values are labels",
    ("slice", "slice", "offset"): "of the plane", ("slice", "contours", "offset"): "of the plane",
}
OTHER_DEFAULTS = {  # (function, argument): why its default is not that of the option
    ("isosurface", "normals"): "scikit-image returns normals",
}
SYNONYMS = {"tetrahedra", "hexahedra", "quadrilaterals"}
CHOICES_OF_OTHERS = {("slice", "cells"): "quad is of graphs", ("extract", "components"): "largest is in the text"}
# The types that the table uses.
TYPES = {"Any": typing.Any, "Point": _arguments.Point, "Box": _arguments.Box, "Bytes": _arguments.Bytes,
         "Headers": _arguments.Headers, "Path": typing.Union[str, "os.PathLike[str]"], "Store": Extracting,
         "Sequence": typing.Sequence, "Mapping": typing.Mapping, "choice": typing.Literal["choice"]}


@functools.lru_cache(maxsize=None)
def table():
    """{command: {option: its entry in the table}}"""
    program = os.environ.get("ISONEST_PROGRAM")
    if not program:
        pytest.skip("ISONEST_PROGRAM names no program")
    done = subprocess.run([program, "--help", "--json"], capture_output=True, text=True, check=True)
    return {command["command"]: {option["name"]: option for option in command["options"] if "python" in option}
            for command in json.loads(done.stdout)["commands"]}


def is_only_here(function, argument):
    return (function.__name__, argument) in ONLY_HERE or ("*", argument) in ONLY_HERE


def parameters_of(command, argument):
    """The functions that have the argument of an option, and the parameter."""
    for function in COMMANDS[command]:
        parameters = inspect.signature(function).parameters
        other = {(command, function.__name__, argument), ("*", function.__name__, argument)} & OTHER_MEANINGS.keys()
        if argument in parameters and not other:
            yield function, parameters[argument]


def arguments_of(command):
    """Pairs of an option of the command and its argument."""
    return [(option, option["python"]["argument"]) for option in table()[command].values()
            if "argument" in option["python"]]


def literals(annotation):
    """The strings that an argument accepts."""
    if typing.get_origin(annotation) is typing.Literal:
        return {choice for choice in typing.get_args(annotation) if isinstance(choice, str)}
    return set().union(*map(literals, typing.get_args(annotation)))


def members(annotation):
    """The types of a union without None; choices of strings count as one type."""
    if typing.get_origin(annotation) is typing.Literal:
        return {"choice"}
    if typing.get_origin(annotation) is typing.Union or type(annotation).__name__ == "UnionType":
        return set().union(*map(members, typing.get_args(annotation)))
    return set() if annotation is type(None) else {str(annotation).replace("typing.", "").replace("ForwardRef('os.PathLike[str]')", "os.PathLike[str]").lower()}


def test_every_command_has_a_function():
    assert set(table()) | {"view"} == set(COMMANDS) | set(COMMANDS_LEFT_OUT)


@pytest.fixture(params=COMMANDS)
def command(request):
    if request.param not in table():
        pytest.skip(f"this build has no {request.param}")
    return request.param


def test_every_option_is_an_argument(command):
    assert len(arguments_of(command)) > 4
    assert [option["name"] for option, argument in arguments_of(command) if not list(parameters_of(command, argument))] == []


def test_every_argument_is_an_option(command):
    names = {argument for _, argument in arguments_of(command)}
    for function in COMMANDS[command]:
        assert {name for name in inspect.signature(function).parameters if name not in names
                and not is_only_here(function, name)} == set(), function.__name__


def test_an_argument_has_the_name_of_its_option_where_python_allows_it():
    other = {(option["name"], argument) for command in COMMANDS if command in table()
             for option, argument in arguments_of(command) if option["name"][2:].replace("-", "_") != argument}
    assert other == {("--force", "replace"), ("--dims", "shape"), ("--type", "dtype"), ("--endian", "dtype"),
                     ("--header", "headers"), ("--output", "path"), ("--output", "store"), ("--plane", "normal"),
                     ("--lambda", "lambda_")}


def test_every_argument_has_the_type_of_its_option(command):
    for option, argument in arguments_of(command):
        expected = members(eval(option["python"]["type"], {}, TYPES))  # noqa: S307
        for function, _ in parameters_of(command, argument):
            assert members(typing.get_type_hints(function)[argument]) == expected, (function.__name__, argument)


def test_a_flag_is_a_bool(command):
    for option, argument in arguments_of(command):
        assert ("bool" in option["python"]["type"]) == (option["value"] in ("", "[=N]", "[=FOLDER]", "[=below|above]")
                                                        or (command, argument) == ("smooth", "grid")), option["name"]


def test_every_choice_is_that_of_the_program(command):
    """The form of an option lists the accepted words, as in none|fast|best, or its text names them."""
    for option, argument in arguments_of(command):
        ours = set()
        for function, _ in parameters_of(command, argument):
            ours |= literals(typing.get_type_hints(function)[argument]) - SYNONYMS
        form = re.findall(r"[\w-]+", option["value"])
        if "choice" not in option["python"]["type"]:
            assert ours == set(), option["name"]
        elif "|" not in option["value"] or (command, argument) in CHOICES_OF_OTHERS:
            assert ours and ours <= set(form) | set(re.findall(r"[\w-]+", option["text"])), option["name"]
        else:
            assert ours == {word for word in form if word.islower()}, option["name"]


def test_every_default_is_that_of_the_program(command):
    """The text of an option ends with its default: [40]."""
    for option, argument in arguments_of(command):
        told = re.search(r"\[([-+.\w]+)\]", option["text"])
        for function, parameter in parameters_of(command, argument):
            ours = parameter.default
            if (function.__name__, argument) in OTHER_DEFAULTS or ours is None or ours is inspect.Parameter.empty:
                continue
            if option["value"] == "":
                assert ours is False, (function.__name__, argument)
            elif told and type(ours) in (int, float):
                assert float(told[1]) == ours, (function.__name__, argument)
            elif told and argument == "memory":
                assert _arguments.to_bytes(told[1]) == _arguments.to_bytes(ours), function.__name__
            elif told and isinstance(ours, str):
                assert told[1] == ours, (function.__name__, argument)


def test_the_tables_name_existing_arguments():
    functions = {function.__name__: inspect.signature(function).parameters
                 for several in COMMANDS.values() for function in several}
    for function, argument in [*ONLY_HERE, *OTHER_DEFAULTS, *(key[1:] for key in OTHER_MEANINGS)]:
        if function != "*":
            assert argument in functions[function], (function, argument)


def test_an_unknown_choice_is_refused_with_a_list_of_choices(tmp_path, noise):
    isonest.preprocess(noise, tmp_path / "x")
    store = isonest.open(tmp_path / "x")
    hints = typing.get_type_hints(Store.isosurface)
    for name in ("indicator", "vertices", "cells", "close", "by", "components", "effort"):
        with pytest.raises(ValueError) as caught:
            store.isosurface(0.3, **{name: "none of them", **({"triangles": 9} if name in ("by", "effort") else {})})
        assert all(repr(choice) in str(caught.value) for choice in literals(hints[name])), name


def test_the_fields_are_those_of_the_program(noise, tmp_path):
    table()
    with pytest.raises(isonest.InvalidArgumentError) as caught:
        isonest.preprocess(noise, tmp_path / "x", indicators=["none"])
    ours = re.findall(r"\w+", caught.value.remedies[0].split(":")[1])
    assert ours[:2] == ["nodes", "all"]
    done = subprocess.run([os.environ["ISONEST_PROGRAM"], "export", "--help"], capture_output=True, text=True, check=True)
    listed = " ".join(done.stdout.split())
    # Indicators of cells come last, and cannot be exported as volumes.
    of_nodes = [name for name in ours[2:] if not name.startswith("hex_")]
    assert len(of_nodes) > 20 and ours[2:] == [*of_nodes, "hex_linf", "hex_deviation"]
    assert ", ".join(of_nodes) + ";" in listed
