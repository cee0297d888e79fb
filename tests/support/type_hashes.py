#!/usr/bin/env python3
"""Prints the ROS 2 type hash (REP 2011, RIHS01) of every message of an IDL file: `ROS_NAME HASH`."""
import hashlib
import json
import re
import sys

# type_description_interfaces/msg/FieldType.
PRIMITIVES = {'uint8': 3, 'int32': 6, 'uint32': 7, 'int64': 8, 'uint64': 9, 'float': 10, 'double': 11, 'boolean': 15, 'octet': 16,
              'string': 17}
NESTED, ARRAY, UNBOUNDED_SEQUENCE = 1, 48, 144


def ros_name(module, type_name):
    package = module if '::' not in type_name else type_name.split('::')[0]
    return f'{package}/msg/{type_name.split("::")[-1].rstrip("_")}'


def field_type(module, text, arrays):
    offset, capacity = 0, 0
    if sequence := re.fullmatch(r'sequence<(.*)>', text):
        offset, text = UNBOUNDED_SEQUENCE, sequence[1]
    elif text in arrays:
        text, capacity = arrays[text]
        offset = ARRAY
    nested = '' if text in PRIMITIVES else ros_name(module, text)
    return {'type_id': offset + PRIMITIVES.get(text, NESTED), 'capacity': capacity, 'string_capacity': 0,
            'nested_type_name': nested}


def read_messages(idl):
    idl = re.sub(r'//.*', '', idl)
    messages = {}
    for module, body in re.findall(r'module (\w+) \{ module msg \{ module dds_ \{(.*?)\}; \}; \};', idl, re.DOTALL):
        arrays = {name: (kind, int(size)) for kind, name, size in re.findall(r'typedef (\w+) (\w+)\[(\d+)\];', body)}
        for name, fields in re.findall(r'struct (\w+) \{(.*?)\}', body, re.DOTALL):
            messages[ros_name(module, name)] = [
                {'name': field, 'type': field_type(module, kind, arrays)}
                for kind, field in re.findall(r'(\S+)\s+(\w+);', fields)]
    return messages


def referenced(messages, name, found):
    for field in messages[name]:
        nested = field['type']['nested_type_name']
        if nested and nested not in found:
            found.add(nested)
            referenced(messages, nested, found)
    return found


def type_hash(messages, name):
    def describe(key):
        return {'type_name': key, 'fields': messages[key]}
    description = {'type_description': describe(name),
                   'referenced_type_descriptions': [describe(key) for key in sorted(referenced(messages, name, set()))]}
    return 'RIHS01_' + hashlib.sha256(json.dumps(description).encode()).hexdigest()


if __name__ == '__main__':
    with open(sys.argv[1], encoding='utf-8') as file:
        all_messages = read_messages(file.read())
    for message in all_messages:
        print(message, type_hash(all_messages, message))
