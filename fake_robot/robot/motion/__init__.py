"""How the body moves under the vendor's own commands: stand, sit, walk, steps."""
