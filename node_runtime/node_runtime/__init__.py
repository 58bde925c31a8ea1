"""What every node needs, and no vehicle: parameters, publishers, spinning, clocks, input ages."""
