"""Orders of reflection between parts of a material: what a BTF rig can leave out."""

MOST_BOUNCES = 8
ORDER = "order-"
ORDERS = tuple(f"{ORDER}{order}" for order in range(2, MOST_BOUNCES + 1))
