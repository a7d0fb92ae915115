"""Checks the custom resources of manifests against schemas; prints all resources as JSON.

    manifests.py SCHEMAS FILE

SCHEMAS is a folder of JSON schemas, one a kind. Resources of Kubernetes itself are left to kubernetes-validate.
"""

import json
import pathlib
import sys

import jsonschema
import yaml


def main():
    folder, path = sys.argv[1:]
    schemas = [json.loads(file.read_text()) for file in sorted(pathlib.Path(folder).glob("*.json"))]
    kinds = {schema["properties"]["kind"]["const"]: schema for schema in schemas}
    with open(path, encoding="utf-8") as file:
        resources = [resource for resource in yaml.safe_load_all(file) if resource]
    wrong = []
    for resource in resources:
        kind, name = resource["kind"], resource["metadata"]["name"]
        if kind in kinds:
            errors = jsonschema.Draft202012Validator(kinds[kind]).iter_errors(resource)
            wrong += [f"{kind} {name}: {error.json_path}: {error.message}" for error in errors]
        elif "." in resource["apiVersion"].split("/")[0] and not resource["apiVersion"].split("/")[0].endswith(".k8s.io"):
            wrong.append(f"{kind} {name}: there is no schema of {resource['apiVersion']}")
    print(json.dumps(resources))
    for line in wrong:
        print(line, file=sys.stderr)
    return 1 if wrong else 0


sys.exit(main())
