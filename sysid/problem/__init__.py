"""The estimation problem: free parameters, simulation of what they predict, sensitivities."""
