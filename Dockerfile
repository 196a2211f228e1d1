# One image for both services: the ground station and the simulated vehicle.
FROM python:3.11-slim

# Compiled loops are kept here between runs; the services may write nowhere else but to their volume.
ENV PYTHONUNBUFFERED=1 XDG_CACHE_HOME=/cache

WORKDIR /app
COPY pyproject.toml constraints.txt README.md LICENSE ./
COPY sim_vehicle sim_vehicle
COPY sysid sysid
COPY gcs gcs
COPY flightmodel flightmodel
RUN pip install --no-cache-dir --constraint constraints.txt . \
    && useradd --system --uid 10001 --no-create-home station \
    && mkdir /data /cache \
    && chown station /data /cache

USER station
VOLUME /data
CMD ["gcs", "--help"]
