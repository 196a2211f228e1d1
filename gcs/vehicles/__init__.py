"""Aircraft as things of the station: kept in versions, described in minutes, chosen for each flight."""
