"""Priority q / P_k of a distance in the cost, and what the distance costs (paper, section 3.3)."""

import casadi as ca

# m; the step of the baseline's priority changes by 80 % within 2.2 of these, 4 cm: a solver that
# uses derivatives needs a continuous cost at contact
STEP_BLEND = 0.02


def gaussian_priority(D, D_sft):
    """Return q / P_k (paper 3.3): 1 in contact, Gaussian within the safety distance, 0 beyond."""
    gauss = ca.exp(-2 * ca.fmax(D, 0) ** 2 / D_sft**2)
    return ca.if_else(D_sft >= D, gauss, 0)


def step_priority(D, D_sft):
    """Return q / P_k of the baseline: 1 within the safety distance, 2 in contact, 0 beyond.

    Brown & Gerdes' published code doubles the cost of an intrusion at contact; the step is blended
    there by a tanh of `STEP_BLEND`. P_k is the weight before contact.
    """
    doubled = (3 - ca.tanh(D / STEP_BLEND)) / 2
    return ca.if_else(D_sft >= D, doubled, 0)


def intrusion(D, D_sft, priority=gaussian_priority):
    """Return the squared error of a distance times q / P_k [m^2] (paper, section 3.3)."""
    return priority(D, D_sft) * (D - D_sft) ** 2


# by the value of the parameter formulation.priority
PRIORITIES = {'gaussian': gaussian_priority, 'step': step_priority}
