"""Units in which a person reads; everything else is SI."""

KPH = 3.6  # km/h per m/s
