# One image for all services: the ground station, the simulated vehicle, and the workers of a fleet.
FROM python:3.11-slim@sha256:9c900dea9e8fb7e16277c179b555cc72d29a352dbc33cff48ad5a0412fd5bfc7

# Compiled loops are kept here between runs; the services may write nowhere else but to their volume.
ENV PYTHONUNBUFFERED=1 XDG_CACHE_HOME=/cache

WORKDIR /app
# What runs here is locked by version and hash; deploy/sbom.cdx.json lists it with licences.
COPY deploy/requirements.lock deploy/requirements.lock
RUN pip install --no-cache-dir --require-hashes --requirement deploy/requirements.lock
COPY pyproject.toml README.md LICENSE ./
COPY sim_vehicle sim_vehicle
COPY sysid sysid
COPY gcs gcs
COPY flightmodel flightmodel
RUN pip install --no-cache-dir --no-deps --no-build-isolation . \
    && useradd --system --uid 10001 --no-create-home station \
    && mkdir /data /cache \
    && chown station /data /cache

USER station
VOLUME /data
CMD ["gcs", "--help"]
