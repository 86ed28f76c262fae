# docker build -t suta_calib .
# docker run --rm -v "$PWD:/work" suta_calib calibrate calibration.yaml
#
# Files that it writes into /work are of user 1000; for another: docker run --user "$(id -u)".
# With more: docker build --build-arg EXTRAS="[vision,ros]" -t suta_calib .
FROM python:3.13-slim AS wheel
WORKDIR /source
COPY pyproject.toml README.md LICENSE ./
COPY suta_calib suta_calib
COPY data data
COPY examples examples
COPY urdf urdf
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /wheel .

FROM python:3.13-slim
ARG EXTRAS=""
COPY constraints.txt requirements.lock /tmp/
RUN --mount=type=bind,from=wheel,source=/wheel,target=/wheel \
    pip install --no-cache-dir --require-hashes -r /tmp/requirements.lock \
    && pip install --no-cache-dir -c /tmp/constraints.txt "$(echo /wheel/*.whl)${EXTRAS}" \
    && useradd --create-home --uid 1000 calibration
# Its number: a host knows no names.
USER 1000
# Whoever the container runs as may write there.
ENV MPLCONFIGDIR=/tmp/matplotlib
WORKDIR /work
ENTRYPOINT ["suta-calib"]
CMD ["--help"]
