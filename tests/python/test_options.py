"""The package has the options of the program: the same names, and the same choices.

The program's options are those of its help. A new option fails this test until the package has an argument with its
name, or a table below gives its name in the package or the reason why there is none; and vice versa.
"""
import inspect
import keyword
import os
import re
import subprocess
import typing

import pytest

import isonest
from isonest import Store, _sources

COMMANDS = {
    "preprocess": [isonest.preprocess],
    "extract": [Store.isosurface, Store.label_surface, Store.label_surfaces, Store.interfaces, Store.graph, isonest.Mesh.save,
                _sources.of_volume],
    "slice": [Store.slice, Store.contours, isonest.Mesh.save, _sources.of_volume],
    "study": [Store.study],
    "smooth": [isonest.smooth, _sources.of_volume],
    "info": [Store.histogram, _sources.of_volume],
    "export": [Store.export],
    "check": [Store.check, _sources.of_volume],
    "view": [Store.view, _sources.of_volume],
}
COMMANDS_LEFT_OUT = {
    "make-volume": "NumPy makes arrays",
    "picture": "VTK and Matplotlib draw meshes",
    "publish": "sites are written by the program alone",
}
RENAMED = {  # (command, option): argument
    ("*", "force"): "replace", ("*", "dims"): "shape", ("*", "type"): "dtype", ("*", "endian"): "dtype",
    ("*", "header"): "headers",
    ("preprocess", "output"): "store", ("extract", "output"): "path", ("slice", "output"): "path",
    ("slice", "plane"): "normal",
}
PICTURES = "pictures and plots are drawn by other packages"
LEFT_OUT = {  # (command, option): why there is no such argument
    ("*", "help"): "help() says it", ("*", "json"): "what is found is returned", ("*", "quiet"): "nothing is printed",
    ("*", "header"): "headers, of isonest.open", ("*", "cache"): "of isonest.open",
    ("*", "keep-store"): "preprocess() makes a store",
    ("extract", "graph"): "a method", ("extract", "interfaces"): "a method", ("extract", "format"): "the end of the name that Mesh.save is given",
    ("extract", "over"): "shift, of Mesh.save",
    ("slice", "size"): PICTURES, ("slice", "colors"): PICTURES, ("slice", "plain"): PICTURES,
    ("slice", "range"): PICTURES, ("slice", "grid"): PICTURES, ("study", "out"): PICTURES,
    ("smooth", "colors"): PICTURES, ("smooth", "size"): PICTURES, ("info", "output"): PICTURES,
    ("info", "histogram"): "a method", ("view", "address"): "only this machine reaches what Python shows",
    ("view", "token"): "there always is one",
}
ONLY_HERE = {  # (function, argument): why the program has no such option
    ("*", "self"): "the store", ("*", "progress"): "the program draws a bar",
    ("*", "coordinates"): "files are in world coordinates", ("*", "scratch"): "the folder of the output",
    ("*", "reading"): "those of preprocess", ("preprocess", "volume"): "INPUT", ("smooth", "volume"): "INPUT",
    ("of_volume", "volume"): "INPUT", ("of_volume", "label_names"): "of preprocess",
    ("of_volume", "labels"): "labels are not smoothed", ("of_volume", "identified"): "resume, of preprocess",
    ("save", "shift"): "over, of meshes of labels",
    ("isosurface", "gradient_direction"): "that of scikit-image", ("slice", "offset"): "the fourth number of the plane",
    ("contours", "offset"): "the fourth number of the plane",
    ("slice", "vertex_values"): "so far for extract alone", ("slice", "quality"): "so far for extract alone",
    ("view", "open"): "the program prints the URL", ("view", "height"): "of the frame in a notebook",
    ("view", "program"): "it is the program",
}
SYNONYMS = {"tetrahedra", "hexahedra", "quadrilaterals"}
CHOICES_LEFT_OUT = {  # (command, option): why the argument accepts other values than the help shows
    ("extract", "distance"): "D[UNIT|voxel] is a number with a unit", ("extract", "labels"): "all is None",
    ("slice", "cells"): "quad is of graphs", ("extract", "components"): "largest is in the words",
}


def help_of(*command):
    program = os.environ.get("ISONEST_PROGRAM")
    if not program:
        pytest.skip("ISONEST_PROGRAM names no program")
    return subprocess.run([program, *command, "--help"], capture_output=True, text=True, check=True).stdout


def options_of(command):
    """The options of a command: name, and the form of its value with its text in the help."""
    found = re.findall(r"^  (?:-\w,)?--([a-z][a-z-]*)(?:\[=(\S+)\])?(?: (\S+(?: \S+)*?))?((?:  | *\n).*(?:\n {28}.*)*)",
                       help_of(command), re.M)
    return {name: (of_flag or form, words) for name, of_flag, form, words in found}


def name_in_python(command, option):
    """The name of the argument."""
    plain = option.replace("-", "_")
    plain = plain + "_" if keyword.iskeyword(plain) else plain
    return RENAMED.get((command, option), RENAMED.get(("*", option), plain))


def left_out(table, owner, name):
    return (owner, name) in table or ("*", name) in table


def test_every_command_has_a_function():
    commands = set(re.findall(r"^  ([a-z][a-z-]+) {2,}\S", help_of(), re.M))
    assert commands | {"view"} == set(COMMANDS) | set(COMMANDS_LEFT_OUT)


@pytest.fixture(params=COMMANDS)
def command(request):
    if request.param == "view" and "\n  view " not in help_of():
        pytest.skip("this build has no viewer")
    return request.param


def test_every_option_is_an_argument(command):
    options = options_of(command)
    assert len(options) > 4
    arguments = {name for function in COMMANDS[command] for name in inspect.signature(function).parameters}
    assert {option for option in options if not left_out(LEFT_OUT, command, option)
            and name_in_python(command, option) not in arguments} == set()


def test_every_argument_is_an_option(command):
    names = {name_in_python(command, option) for option in options_of(command)}
    for function in COMMANDS[command]:
        assert {name for name in inspect.signature(function).parameters if name not in names
                and not left_out(ONLY_HERE, function.__name__, name)} == set(), function.__name__


def test_the_tables_name_existing_options_and_arguments():
    options = {command: options_of(command) for command in COMMANDS if f"\n  {command} " in help_of()}
    for command, option in [*RENAMED, *LEFT_OUT, *CHOICES_LEFT_OUT]:
        if command in options:
            assert option in options[command], (command, option)
    functions = {function.__name__: inspect.signature(function).parameters
                 for several in COMMANDS.values() for function in several}
    for function, argument in ONLY_HERE:
        if function != "*":
            assert argument in functions[function], (function, argument)


def literals(annotation):
    """The strings that an argument accepts."""
    if typing.get_origin(annotation) is typing.Literal:
        return {choice for choice in typing.get_args(annotation) if isinstance(choice, str)}
    return set().union(*map(literals, typing.get_args(annotation)))


def test_every_choice_is_that_of_the_program(command):
    """The form of an option lists the accepted words, largest|K|all, or its description names them."""
    for option, (form, words) in options_of(command).items():
        ours = set()
        for function in COMMANDS[command]:
            if name_in_python(command, option) in inspect.signature(function).parameters:
                ours |= literals(typing.get_type_hints(function)[name_in_python(command, option)]) - SYNONYMS
        if "|" not in form:
            assert ours <= set(re.findall(r"[\w-]+", words)), option
        elif not left_out(CHOICES_LEFT_OUT, command, option) and not left_out(LEFT_OUT, command, option):
            assert ours == {word for word in form.split("|") if word.islower()}, option


def test_an_unknown_choice_is_refused_with_a_list_of_choices(tmp_path, noise):
    isonest.preprocess(noise, tmp_path / "x")
    store = isonest.open(tmp_path / "x")
    hints = typing.get_type_hints(Store.isosurface)
    for name in ("indicator", "vertices", "cells", "close", "by", "components", "effort"):
        with pytest.raises(ValueError) as caught:
            store.isosurface(0.3, **{name: "none of them", **({"triangles": 9} if name in ("by", "effort") else {})})
        assert all(repr(choice) in str(caught.value) for choice in literals(hints[name])), name


def test_the_fields_are_those_of_the_program(noise, tmp_path):
    with pytest.raises(isonest.InvalidArgumentError) as caught:
        isonest.preprocess(noise, tmp_path / "x", indicators=["none"])
    ours = re.findall(r"\w+", caught.value.remedies[0].split(":")[1])
    assert ours[:2] == ["nodes", "all"]
    listed = " ".join(help_of("export").split())
    # Indicators of cells come last, and cannot be exported as volumes.
    of_nodes = [name for name in ours[2:] if not name.startswith("hex_")]
    assert len(of_nodes) > 20 and ours[2:] == [*of_nodes, "hex_linf", "hex_deviation"]
    assert ", ".join(of_nodes) + ";" in listed
