"""Parameter files, looked at before ROS reads them: its own complaints name no line and no key."""
from __future__ import annotations

from itertools import pairwise
from pathlib import Path

from hpv_twin.model import yaml_text

FILE_OPTION = '--params-file'
VALUE_OPTIONS = ('-p', '--param')
MARK = 'ros__parameters'


class ParameterError(ValueError):
    """A parameter that cannot be used; the message names it, its value and its bound."""


def origins(argv: list[str]) -> dict[str, str]:
    """
    The file that each parameter comes from, for every `--params-file` of a command line.

    What a `-p` gives later comes from none. Raises ParameterError, with the file's name, for one
    that cannot be read as parameters.
    """
    found = {}
    for option, value in pairwise(argv):
        if option == FILE_OPTION:
            found |= dict.fromkeys(names(value), value)
        elif option in VALUE_OPTIONS:
            found.pop(value.partition(':=')[0].rpartition(':')[2], None)
    return found


def names(path: str) -> list[str]:
    """Names of the parameters in a file, those of a group joined with dots."""
    try:
        content = yaml_text.parse(Path(path).read_bytes().decode())
    except UnicodeDecodeError:
        raise ParameterError(f'{path}: not a text file (UTF-8 YAML expected)') from None
    except OSError as error:
        raise ParameterError(f'{path}: {error.strerror or error}') from None
    except yaml_text.YamlError as error:
        raise ParameterError(f'{path}: {error}') from None
    if content is None:
        raise ParameterError(f'{path}: empty: expected "/**:", "  {MARK}:" and parameters below')
    return list(parameters(path, content, ()))


def parameters(path, content, above):
    """Walk down from node names to parameters; what stands elsewhere is an error."""
    if not isinstance(content, dict):
        place = ': '.join(map(str, above)) or 'the file'
        raise ParameterError(f'{path}: {place}: {str(content)[:40]} stands where node names and '
                             f'"{MARK}:" are expected')
    for key, value in content.items():
        if key == MARK:
            if not isinstance(value, dict):
                raise ParameterError(f'{path}: {MARK}: {str(value)[:40]} stands where "name: '
                                     'value" lines are expected')
            yield from leaves(value, '')
        else:
            yield from parameters(path, value, (*above, key))


def leaves(group, prefix):
    """Names of the parameters of a group."""
    for key, value in group.items():
        if isinstance(value, dict):
            yield from leaves(value, f'{prefix}{key}.')
        else:
            yield f'{prefix}{key}'
