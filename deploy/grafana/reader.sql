-- A user for Grafana that may read the views and nothing else. Run it as the owner of the database:
--   psql "$STEMWATCH_STORAGE_URL" --set password="$STEMWATCH_GRAFANA_PASSWORD" --file reader.sql
CREATE ROLE stemwatch_reader LOGIN PASSWORD :'password';
GRANT SELECT ON
    stemwatch_valves_v1, stemwatch_runs_v1, stemwatch_screenings_v1, stemwatch_indicators_v1,
    stemwatch_alerts_v1, stemwatch_tags_v1, stemwatch_samples_v1,
    stemwatch_valves_v2, stemwatch_screenings_v2, stemwatch_alerts_v2
    TO stemwatch_reader;
-- Somebody who asks for years of samples shall not hold up those who store them.
ALTER ROLE stemwatch_reader SET statement_timeout = '30s';
ALTER ROLE stemwatch_reader SET default_transaction_read_only = on;
