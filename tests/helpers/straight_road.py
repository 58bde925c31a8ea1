"""The scenario `straight` with other values."""

from msgs_yaml import share

# the length of a drive that a test ends itself
LONG = {
    'length_m: 140.0': 'length_m: 4000.0',
    'length_m: 120.0': 'length_m: 3900.0',
    'progress_m: 60.0, time_s: 10.0': 'progress_m: 3800.0, time_s: 600.0',
}


def write_straight(folder, changes):
    """Write the scenario with texts replaced; return the path of the file as text."""
    text = share.path('scenario_publisher', 'scenarios', 'straight.yaml').read_text()
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    file = folder / 'straight.yaml'
    file.write_text(text)
    return str(file)
