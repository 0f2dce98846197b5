"""YAML read with complaints of one line that name the place."""
import yaml


class YamlError(ValueError):
    """Text that is not YAML; the message is one line: the place and the reason."""


def parse(text: str):
    """Return what a YAML text holds, of plain types alone; raise YamlError."""
    try:
        return yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise YamlError(f'not YAML: {place_and_reason(error)}') from None
    except Exception as error:
        # A date that is none, "!!int" with nothing behind it, a nesting without end: the library
        # lets errors of many kinds pass.
        raise YamlError(f'not YAML: {" ".join(str(error).split())}') from None


def place_and_reason(error: yaml.YAMLError) -> str:
    """Line, column and problem, as far as the error knows them."""
    mark = getattr(error, 'problem_mark', None)
    where = f'line {mark.line + 1}, column {mark.column + 1}: ' if mark else ''
    problem = getattr(error, 'problem', None) or getattr(error, 'reason', None) or 'unreadable'
    return where + ' '.join(str(problem).split())
