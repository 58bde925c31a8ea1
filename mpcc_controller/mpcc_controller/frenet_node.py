"""The controller node with the baseline; a parameter file chooses what is in force."""

import sys

from mpcc_controller import controller_node

CONFIG = 'frenet.yaml'


def main() -> None:
    """Run until stopped; exit with the node's code."""
    sys.exit(controller_node.run(CONFIG))


if __name__ == '__main__':
    main()
