"""Figures by stage, one in each module: data in, a Matplotlib figure out; no page knows how it is drawn.

`style` has the colours, sizes and helpers that they share.
"""
