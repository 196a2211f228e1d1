"""The ground station: links, recording, flights, jobs, REST and the command line."""
