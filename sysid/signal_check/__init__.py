"""Wrong units, signs, axes, scales and delays of the sensors: found, named, put right."""
