"""Write documentation/ of an FMU: a page that needs no other file, and the licence."""

from __future__ import annotations

import base64
import html
from importlib.resources import files

from cosim.fmu.export.certificate_section import certified_section
from cosim.fmu.export.components import components_folder
from cosim.fmu.export.page.connect import connect_section
from cosim.fmu.export.page.text import to_html
from cosim.fmu.export.page.variable_tables import variable_tables
from cosim.fmu.export.spec import CERTIFICATE, ComponentSpec


def documentation_files(spec: ComponentSpec) -> dict[str, bytes]:
    """Return by archive path documentation/index.html, the licence and model.png."""
    licence = components_folder().joinpath("LICENSE").read_bytes()
    picture = spec.readme.with_name("model.png").read_bytes()
    return {
        "documentation/index.html": _page(spec, picture).encode(),
        "documentation/licenses/license.txt": licence,
        "model.png": picture,
    }


def _page(spec: ComponentSpec, picture: bytes) -> str:
    name = html.escape(spec.name)
    certified = ""
    if spec.certificate is not None:
        certified = certified_section(spec.certificate, f"{spec.name}.fmu")
    links = [("what", "What it computes"), ("connect", "Connect it"), ("variables", "Variables")]
    if certified:
        links.insert(1, ("certified", "What is certified"))
    icon = base64.b64encode(picture).decode()
    style = files("cosim.fmu.export.page").joinpath("style.css").read_text("utf-8")
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{name}</title>\n<style>\n{style}</style></head><body>\n"
        f'<header><img src="data:image/png;base64,{icon}" alt="{name}">'
        f'<div><h1>{name}</h1>\n<p class="lead">{html.escape(spec.description)}.</p></div>'
        "</header>\n<nav>"
        + "".join(f'<a href="#{anchor}">{title}</a>' for anchor, title in links)
        + f'</nav>\n<p class="facts">{_facts(spec)}</p>\n'
        f'<h2 id="what">What it computes</h2>\n{to_html(spec.readme.read_text("utf-8"))}'
        f"{to_html(spec.notes)}{certified}"
        f'<h2 id="connect">Connect it</h2>\n{connect_section(spec)}'
        f'<h2 id="variables">Variables</h2>\n{variable_tables(spec)}'
        f"<footer>{_licence(spec)}</footer></body></html>\n"
    )


def _facts(spec: ComponentSpec) -> str:
    facts = ["FMU for co-simulation"]
    for causality in ("input", "output", "parameter"):
        count = sum(v.causality == causality for v in spec.variables)
        facts.append(f"{count} {causality}{'' if count == 1 else 's'}")
    if all(v.unit is not None for v in spec.variables if v.causality != "parameter"):
        facts.append("SI units")
    facts.append(f"by default {spec.stop_time:g} s in steps of {spec.step_size:g} s")
    return " · ".join(facts)


def _licence(spec: ComponentSpec) -> str:
    proof = f", the proof in <code>{CERTIFICATE}</code>" if spec.certificate is not None else ""
    return (
        'MIT licence: <a href="licenses/license.txt">license.txt</a>. The FMU is a zip archive; '
        "the code that it runs is inside as text, in <code>sources/</code> or "
        f"<code>resources/</code>{proof}."
    )
