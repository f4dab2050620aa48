# bladescout for the companion computer or a desk: amd64 and arm64.
#   docker build --tag bladescout .
#   docker run --network host --volume ./missions:/var/lib/bladescout/missions bladescout
#   docker run --rm bladescout simulate demo

FROM python:3.11-slim AS build
WORKDIR /src
RUN python -m venv /opt/bladescout
ENV PATH=/opt/bladescout/bin:$PATH PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1
COPY requirements.lock ./
RUN pip install --require-hashes --only-binary :all: -r requirements.lock
COPY pyproject.toml README.md ./
COPY config config
COPY perception perception
COPY drivers drivers
COPY mission mission
COPY bladescout bladescout
COPY benchmarks benchmarks
# The lock holds the tools of development too; what flies does not need them.
RUN pip install --no-deps --no-build-isolation . \
    && pip uninstall --yes mypy ruff pytest pytest-asyncio pytest-timeout hypothesis \
       import-linter grimp scipy-stubs types-protobuf types-psutil setuptools pip

FROM python:3.11-slim
# What Open3D links; its libusb comes with a wheel. Nothing here draws by OpenGL: Mesa's drivers and
# the compiler that they bring (160 MB) are left out. Debian keeps no old versions to pin.
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install --yes --no-install-recommends libegl1 libgl1 libgomp1 libx11-6 \
    && rm -rf /var/lib/apt/lists/* /usr/lib/*-linux-gnu/dri \
       /usr/lib/*-linux-gnu/libLLVM* /usr/lib/*-linux-gnu/libz3.so* \
    && useradd --system --uid 10001 --user-group --create-home \
       --home-dir /var/lib/bladescout bladescout \
    && mkdir /var/lib/bladescout/missions /var/lib/bladescout/field \
    && chown bladescout: /var/lib/bladescout/missions /var/lib/bladescout/field
COPY --from=build /opt/bladescout /opt/bladescout
ENV PATH=/opt/bladescout/bin:$PATH PYTHONUNBUFFERED=1
USER 10001
WORKDIR /var/lib/bladescout
VOLUME /var/lib/bladescout/missions
STOPSIGNAL SIGTERM
# The daemon answers a status request over the bus, flying or not.
HEALTHCHECK --interval=30s --timeout=10s --start-period=30s CMD ["bladescout", "status", "--json"]
ENTRYPOINT ["bladescout"]
CMD ["serve"]
