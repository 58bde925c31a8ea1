"""Tyre property files for tests."""

from vehicle_plant import parameters


def property_file(name: str) -> str:
    """Return a tyre of vehicle_plant/config as the text of a .tir file."""
    tyre = parameters.load_tyre(name)
    sections = {
        'VERTICAL': (tyre.reference,),
        'LONGITUDINAL_COEFFICIENTS': (tyre.longitudinal, tyre.combined_longitudinal),
        'LATERAL_COEFFICIENTS': (tyre.lateral, tyre.combined_lateral),
    }
    lines = ['[MODEL]', 'FITTYP = 61']
    for section, groups in sections.items():
        lines += [f'[{section}]', *(f'{k} = {v!r}' for one in groups for k, v in vars(one).items())]
    return '\n'.join(lines) + '\n'
