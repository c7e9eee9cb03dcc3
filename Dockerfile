# The server in a container: CPU only, no root, nothing written. docs/guide/deploy.md says how to run it.
ARG PYTHON=python:3.11-slim

FROM ${PYTHON} AS build
WORKDIR /src
COPY pyproject.toml constraints.txt README.md LICENSE ./
COPY runtime ./runtime
COPY train ./train
COPY export ./export
COPY server ./server
RUN python -m pip wheel --no-deps --wheel-dir /wheels .
RUN python -m venv /opt/slide
RUN /opt/slide/bin/python -m pip install --constraint constraints.txt "$(ls /wheels/slide_planner-*.whl)[server,refine]"

FROM ${PYTHON}
COPY --from=build /opt/slide /opt/slide
ENV PATH=/opt/slide/bin:/usr/local/bin:/usr/bin:/bin \
    PYTHONDONTWRITEBYTECODE=1 \
    PYTHONUNBUFFERED=1 \
    OMP_NUM_THREADS=1 \
    ORT_DISABLE_TELEMETRY=1 \
    SLIDE_HOST=0.0.0.0 \
    SLIDE_PORT=8000
WORKDIR /srv
USER 10001:10001
EXPOSE 8000
STOPSIGNAL SIGTERM
HEALTHCHECK --interval=10s --timeout=3s --start-period=20s --retries=3 \
    CMD ["python", "-c", "import os, urllib.request as http; http.urlopen('http://127.0.0.1:' + os.environ['SLIDE_PORT'] + '/health/ready', timeout=2)"]
ENTRYPOINT ["slide-serve"]
