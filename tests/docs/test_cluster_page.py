"""The files of the page on clusters, of which none runs here: they are at least well formed."""

from __future__ import annotations

import ast
import inspect
import shutil
import subprocess

import pytest
import yaml
from distributed import SSHCluster
from docs.page_blocks import DOCS, blocks_of

from cosim import run_study

BLOCKS = blocks_of(DOCS / "how-to" / "clusters.md")


def calls(name: str) -> list[ast.Call]:
    """The calls of a function in the Python of the page."""
    trees = [ast.parse(block.text) for block in BLOCKS if block.language == "python"]
    found = [n for tree in trees for n in ast.walk(tree) if isinstance(n, ast.Call)]
    return [call for call in found if getattr(call.func, "id", None) == name]


@pytest.mark.parametrize(
    ("name", "function"), [("run_study", run_study), ("SSHCluster", SSHCluster)]
)
def test_calls_have_arguments_that_exist(name: str, function: object) -> None:
    """Of what is installed here; dask-jobqueue is not."""
    known = inspect.signature(function).parameters  # type: ignore[arg-type]
    assert calls(name)
    for call in calls(name):
        assert {word.arg for word in call.keywords} <= known.keys()


def test_the_manifest_is_yaml_whose_parts_name_each_other() -> None:
    """The autoscaler scales the cluster, ports are those that the service forwards to."""
    text = next(block.text for block in BLOCKS if block.language == "yaml")
    cluster, autoscaler = yaml.safe_load_all(text)
    assert autoscaler["spec"]["cluster"] == cluster["metadata"]["name"]
    scheduler = cluster["spec"]["scheduler"]
    ports = {port["name"] for port in scheduler["spec"]["containers"][0]["ports"]}
    assert {port["targetPort"] for port in scheduler["service"]["ports"]} == ports
    assert scheduler["service"]["selector"]["dask.org/cluster-name"] == cluster["metadata"]["name"]


def test_job_scripts_are_scripts() -> None:
    """A shell can read them."""
    scripts = [block.text for block in BLOCKS if block.text.startswith("#!")]
    assert len(scripts) == 2
    bash = shutil.which("bash")
    for text in scripts if bash else ():
        subprocess.run([str(bash), "-n"], input=text, text=True, check=True)  # noqa: S603
