#!/usr/bin/env python3
"""The cases of scripts in one process, and so in one launch, in order: together.py NAME ..."""

import sys
from importlib import import_module
from unittest import TestCase, TestLoader, TestSuite


def suite():
    """The cases of test_NAME.py for each argument NAME."""
    loader = TestLoader()
    modules = [
        import_module(f"test_{word}") for word in sys.argv[1:] if "=" not in word and word[0] not in "-_"
    ]
    own = [
        value
        for module in modules
        for value in vars(module).values()
        if isinstance(value, type) and issubclass(value, TestCase) and value.__module__ == module.__name__
    ]
    return TestSuite(map(loader.loadTestsFromTestCase, own))


if __name__ == "__main__":
    import rostest

    rostest.rosrun("husky_highlevel_controller", "together", "together.suite")
