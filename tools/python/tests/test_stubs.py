"""The stubs name what the module has, with the parameters that it has."""
import ast
import inspect
import sys
from pathlib import Path

import csbrdf
from csbrdf import _csbrdf

FOLDER = Path(csbrdf.__file__).parent


def members(node):
    return {n.name: n for n in node.body if isinstance(n, (ast.FunctionDef, ast.ClassDef))}


def test_stubs_and_module_agree():
    assert (FOLDER / "py.typed").exists()
    stubs = members(ast.parse((FOLDER / "_csbrdf.pyi").read_text()))
    assert set(stubs) == {n for n in dir(_csbrdf) if not n.startswith("__")}
    assert set(csbrdf.__all__) == {*stubs, "Origin"}
    for name, stub in stubs.items():
        thing = getattr(_csbrdf, name)
        assert thing.__doc__
        if isinstance(stub, ast.ClassDef) and name != "Error":
            found = {n for n in vars(thing) if not n.startswith("__") or n == "__new__" and name == "Brdf"}
            assert set(members(stub)) == found
            for method, node in members(stub).items():
                if not node.decorator_list and method != "__new__":
                    assert getattr(thing, method).__doc__
                    assert list(inspect.signature(getattr(thing, method)).parameters) == [a.arg for a in node.args.args]
    assert list(inspect.signature(csbrdf.open).parameters) == [a.arg for a in stubs["open"].args.args]
    if sys.version_info < (3, 10):
        return  # no signatures of compiled classes
    assert list(inspect.signature(csbrdf.Brdf).parameters) == [a.arg for a in stubs["Brdf"].body[0].args.args[1:]]
