"""The Kubernetes manifests of the cluster page have the fields that the schemas published for them have.

The schemas are those that `dask-kubernetes` ships with its operator and those of Kubernetes in `kubernetes-validate`;
`.ci/run` fetches both. Without them these tests skip.
"""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from mcstudy.cli.parser import parser_of

yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")
ROOT = Path(__file__).parents[2]
PAGE = ROOT / "mcstudy" / "study" / "CLUSTER.md"
KUBERNETES = ("1.28", "1.34")
"""Versions whose schemas the core objects must conform to."""


def manifests() -> dict[str, dict[str, Any]]:
    """Every object of the page's ``yaml`` blocks, by kind."""
    blocks = re.findall(r"^```yaml\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    return {o["kind"]: o for block in blocks for o in yaml.safe_load_all(block)}


def closed(schema: Any) -> Any:
    """An OpenAPI schema as a JSON schema that refuses fields it does not name, which Kubernetes drops silently."""
    if isinstance(schema, list):
        return [closed(s) for s in schema]
    if not isinstance(schema, dict):
        return schema
    out = {key: closed(value) for key, value in schema.items()}
    if schema.get("x-kubernetes-int-or-string") is True:
        return {"type": ["integer", "string"]}
    if isinstance(schema.get("properties"), dict) and schema.get("type") == "object":
        out.setdefault("additionalProperties", schema.get("x-kubernetes-preserve-unknown-fields", False))
    return out


@pytest.fixture(scope="module")
def operator() -> dict[str, Any]:
    """The schema of a DaskCluster."""
    found = importlib.util.find_spec("dask_kubernetes")
    if found is None or found.origin is None:
        pytest.skip("dask-kubernetes is not installed, which ships the operator's schemas")
    folder = Path(found.origin).parent / "operator"
    (file,) = folder.glob("**/crds/daskcluster.yaml")
    (version,) = [v for v in yaml.safe_load(file.read_text())["spec"]["versions"] if v["name"] == "v1"]
    return dict(version["schema"]["openAPIV3Schema"])


def refused(schema: dict[str, Any], document: dict[str, Any]) -> list[str]:
    """What the schema refuses; the object's own type and name are checked by Kubernetes, not by this schema."""
    spec = {"spec": document["spec"]}
    only = {**schema, "properties": {"spec": schema["properties"]["spec"]}, "required": ["spec"]}
    return [error.message for error in jsonschema.Draft202012Validator(closed(only)).iter_errors(spec)]


def changed(document: Any, path: tuple[str | int, ...], value: Any) -> Any:
    """A copy with one value replaced."""
    if not path:
        return value
    key, *rest = path
    copy = list(document) if isinstance(document, list) else dict(document)
    copy[key] = changed(copy.get(key) if isinstance(copy, dict) else copy[int(key)], tuple(rest), value)  # type: ignore[index]
    return copy


def test_the_page_has_a_claim_a_cluster_and_a_job() -> None:
    assert set(manifests()) == {"PersistentVolumeClaim", "DaskCluster", "Job"}


def test_the_cluster_conforms_to_the_operators_schema(operator: dict[str, Any]) -> None:
    assert refused(operator, manifests()["DaskCluster"]) == []


CONTAINER = ("spec", "worker", "spec", "containers", 0)
MISTAKES: dict[str, tuple[tuple[str | int, ...], Any]] = {
    "replicas as text": (("spec", "worker", "replicas"), "eight"),
    "misspelt field": ((*CONTAINER, "volumeMount"), []),
    "a number as value": ((*CONTAINER, "env", 0, "value"), 1),
    "no service": (("spec", "scheduler"), {"spec": {}}),
    "port without number": (("spec", "scheduler", "service", "ports", 0), {"name": "tcp-comm"}),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_the_operators_schema_refuses_a_mistake(operator: dict[str, Any], mistake: str) -> None:
    assert refused(operator, changed(manifests()["DaskCluster"], *MISTAKES[mistake]))


def core_objects() -> Iterator[dict[str, Any]]:
    """Objects of Kubernetes itself: of the page, and the pods and the service that the operator makes from it."""
    every = manifests()
    yield every["PersistentVolumeClaim"]
    yield every["Job"]
    spec = every["DaskCluster"]["spec"]
    for name in ("scheduler", "worker"):
        yield {"apiVersion": "v1", "kind": "Pod", "metadata": {"name": name}, "spec": spec[name]["spec"]}
    yield {"apiVersion": "v1", "kind": "Service", "metadata": {"name": "s"}, "spec": spec["scheduler"]["service"]}


@pytest.mark.parametrize("version", KUBERNETES)
def test_core_objects_conform_to_the_schemas_of_kubernetes(version: str) -> None:
    kubernetes_validate = pytest.importorskip("kubernetes_validate", reason="kubernetes-validate is not installed")
    for document in core_objects():
        kubernetes_validate.validate(document, version, strict=True)
        spec = {**document["spec"], "acessModes": []}
        with pytest.raises(kubernetes_validate.ValidationError):
            kubernetes_validate.validate({**document, "spec": spec}, version, strict=True)


def commands() -> dict[str, tuple[dict[str, Any], dict[str, Any]]]:
    """Containers by name, each with the specification of its pod."""
    every = manifests()
    pods = [every["DaskCluster"]["spec"][name]["spec"] for name in ("scheduler", "worker")]
    pods.append(every["Job"]["spec"]["template"]["spec"])
    return {c["name"]: (c, pod) for pod in pods for c in pod["containers"]}


def test_every_command_is_one_that_dask_and_mcstudy_understand(tmp_path: Path) -> None:
    from distributed.cli import dask_scheduler, dask_worker

    for name in ("cert.pem", "key.pem"):
        (tmp_path / name).write_text("")
    read = {name: [str(a).replace("/tls/", f"{tmp_path}/") for a in c["args"]] for name, (c, _) in commands().items()}
    assert [args[:2] for args in read.values()] == [["dask", "scheduler"], ["dask", "worker"], ["mcstudy", "run"]]
    scheduler = dask_scheduler.main.make_context("scheduler", read["scheduler"][2:]).params
    assert (scheduler["protocol"], int(scheduler["port"])) == ("tls", 8786)
    worker = dask_worker.main.make_context("worker", read["worker"][2:]).params
    assert (worker["nthreads"], worker["scheduler"]) == (8, "tls://mcstudy-scheduler:8786")
    run = parser_of("run").parse_args(read["run"][2:])
    assert run.scheduler == worker["scheduler"]


def test_what_a_container_mounts_its_pod_has_and_the_ports_are_those_of_the_service() -> None:
    every = manifests()
    claim = every["PersistentVolumeClaim"]["metadata"]["name"]
    for container, pod in commands().values():
        volumes = {volume["name"]: volume for volume in pod["volumes"]}
        assert {mount["name"] for mount in container["volumeMounts"]} == set(volumes)
        assert volumes["tls"]["secret"]["secretName"] in PAGE.read_text(encoding="utf-8").split("kubectl apply")[0]
        if "results" in volumes:
            assert volumes["results"]["persistentVolumeClaim"]["claimName"] == claim
    scheduler, _ = commands()["scheduler"]
    ports = {p["name"]: p["containerPort"] for p in scheduler["ports"]}
    service = every["DaskCluster"]["spec"]["scheduler"]["service"]
    assert {p["targetPort"]: p["port"] for p in service["ports"]} == ports
    assert service["selector"]["dask.org/cluster-name"] == every["DaskCluster"]["metadata"]["name"]
