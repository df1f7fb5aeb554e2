"""YAML of other programs: plain values whatever tags they have, and nothing is ever executed."""

from __future__ import annotations

import yaml


class UntaggedLoader(yaml.SafeLoader):
    """PyYAML's safe loader, for which a tag that it does not know means nothing.

    Programs write `!!python/tuple` or `!Camera` where a list or a mapping is meant.
    """


def _without_tag(loader: yaml.SafeLoader, suffix: str, node: yaml.Node) -> object:
    """The value that a node has without its tag: a text, a number, a list or a mapping."""
    if "python/object/apply" in node.tag or "python/object/new" in node.tag:  # what is meant is the result of a call
        raise yaml.constructor.ConstructorError(problem=f"{node.tag} is not called", problem_mark=node.start_mark)
    if isinstance(node, yaml.MappingNode):
        return loader.construct_mapping(node, deep=True)
    if isinstance(node, yaml.SequenceNode):
        return loader.construct_sequence(node, deep=True)
    tag = loader.resolve(yaml.ScalarNode, node.value, (True, False))
    return loader.construct_object(yaml.ScalarNode(tag, node.value))


UntaggedLoader.add_multi_constructor("", _without_tag)
