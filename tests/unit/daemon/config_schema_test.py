#!/usr/bin/env python3
"""Compares config/nilio.schema.json, which editors use, with niliod, key by key: both accept the default and refuse
a value of another type, a number out of range and a misspelt name. The shipped files are valid.

  config_schema_test.py SOURCE_FOLDER NILIOD
Exit status 77 without python3-jsonschema or python3-yaml.
"""
import json
import os
import subprocess
import sys
import tempfile

try:
    import jsonschema
    import yaml
except ImportError as missing:
    print(f"skipped: {missing}")
    sys.exit(77)

source, niliod = sys.argv[1:]
with open(f"{source}/config/nilio.schema.json") as file:
    schema = json.load(file)
jsonschema.Draft7Validator.check_schema(schema)
validator = jsonschema.Draft7Validator(schema)
environment = {name: value for name, value in os.environ.items() if not name.startswith("NILIO_")}
failed = 0


def expect(condition, text):
    global failed
    if not condition:
        failed += 1
        print(f"FAILED: {text}")


def keys_of(section, path=()):
    for name, value in section["properties"].items():
        if "properties" in value:
            yield from keys_of(value, path + (name,))
        else:
            yield path + (name,), value


def nested(path, value):
    for name in reversed(path):
        value = {name: value}
    return value


def niliod_accepts(configuration):
    """JSON is YAML."""
    with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
        json.dump(configuration, file)
        file.flush()
        status = subprocess.run([niliod, "--check-config", "--config", file.name], env=environment,
                                capture_output=True).returncode
    expect(status in (0, 2), f"niliod --check-config: exit status {status} for {configuration}")
    return status == 0


def wrong_values(key):
    """Value of another type, and those below and above the range."""
    number = key.get("items", key)
    yield {"boolean": "yes?", "integer": 1.5, "number": "1", "array": "1"}.get(str(key["type"]), [1])
    if "minimum" in number:
        for value in (number["minimum"] - 1, number["maximum"] + 1):
            yield [0, value, 0] if key["type"] == "array" else value
    if "enum" in key:
        yield key["enum"][0] + "?"


count = 0
for path, key in keys_of(schema):
    count += 1
    accepted = nested(path, key["default"])
    expect(validator.is_valid(accepted), f"schema refuses the default {accepted}")
    expect(niliod_accepts(accepted), f"niliod refuses the default {accepted}")
    wrong = [nested(path, value) for value in wrong_values(key)]
    wrong.append(nested(path[:-1] + (path[-1] + "x",), key["default"]))
    for configuration in wrong:
        expect(not validator.is_valid(configuration), f"schema accepts {configuration}")
        expect(not niliod_accepts(configuration), f"niliod accepts {configuration}")
for name in ("vehicle", "reference"):
    with open(f"{source}/config/{name}.yaml") as file:
        expect(file.readline().startswith("# yaml-language-server: $schema="), f"{name}.yaml names no schema")
        for error in validator.iter_errors(yaml.safe_load(file)):
            expect(False, f"{name}.yaml: {error.message}")
expect(count > 170, f"only {count} keys")
print(f"{count} keys, {failed} failures")
sys.exit(1 if failed else 0)
