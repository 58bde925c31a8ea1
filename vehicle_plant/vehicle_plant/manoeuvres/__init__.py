"""Standard open-loop manoeuvres of the plant, and the closed forms that they are held against."""
