"""Recorded ticks, answered again: has the controller changed, and what if it had?"""
