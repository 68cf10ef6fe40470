"""How the structure of a material looks over distance."""
