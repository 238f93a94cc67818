#!/usr/bin/env python3
"""Writes the border between a program of Windows and libPComm32W.so: `border.py SPEC C` from the functions of pmacu.h.

SPEC tells winebuild the exports; C has, for each, a function that takes its arguments as Windows passes them.
"""

import pathlib
import re
import sys

HEADER = pathlib.Path(__file__).parent.parent / "pcomm32" / "include" / "pmacu.h"
# callbacks.c has these: they hand a function of the program to the library.
BY_HAND = {"PmacDownloadA", "PmacDPRTest", "PmacMultiDownloadA", "PmacThreadDownloadA", "PmacINTRFuncCallInit",
           "PmacINTRWndMsgInit"}


def functions():
    """Yields result, name and parameters of each function."""
    text = re.sub(r"/\*.*?\*/", " ", HEADER.read_text(), flags=re.S)
    for result, name, parameters in re.findall(r"^([\w ]+?[ *])WINAPI (\w+)\(([^;]*)\);", text, flags=re.M):
        parameters = " ".join(parameters.split())
        yield result.strip(), name, [] if parameters == "void" else parameters.split(", ")


def spec_type(parameter):
    if "*" in parameter or "[" in parameter or re.match(r"(P|LP)[A-Z]", parameter) or parameter.split()[0].endswith("PROC"):
        return "ptr"
    return parameter.split()[0] if parameter.split()[0] in ("double", "float") else "long"


def name_of(parameter):
    return re.search(r"(\w+)(\[\d*\])?$", parameter)[1]


def main(spec, source):
    exports, borders = [], []
    for result, name, parameters in functions():
        exports.append(f"@ stdcall {name}({' '.join(spec_type(parameter) for parameter in parameters)}) windows_{name}")
        if name in BY_HAND:
            continue
        call = f"{name}({', '.join(name_of(parameter) for parameter in parameters)})"
        body = f"{call};" if result == "void" else f"return {call};"
        if result.startswith("struct "):
            result, body = f"RETURNED({result})", f"RETURN({result}, {call});"
        borders.append(f"{result} WINDOWS windows_{name}({', '.join(parameters) or 'void'})\n{{\n    {body}\n}}\n")
    pathlib.Path(spec).write_text("\n".join(exports) + "\n")
    pathlib.Path(source).write_text('#include "windows_border.h"\n\n' + "\n".join(borders))


main(*sys.argv[1:])
